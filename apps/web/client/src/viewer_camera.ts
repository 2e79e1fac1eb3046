// The viewer's own camera as a source of the server: JPEG frames by POST, one on its way at a time, so
// that the newest counts and a slow line gets fewer.
import { signal } from '@preact/signals';
import { api, errorText } from './api';

export interface ViewerCameraState {
  id: string; // "viewer:ab12"
  width: number;
  height: number;
  sent: number;
  fps: number;
  problem: string;
}

export const viewerCamera = signal<ViewerCameraState | undefined>(undefined);

let stream: MediaStream | undefined;
let video: HTMLVideoElement | undefined;
let running = 0;

// Why there can be no camera here, in plain words; "" where there can.
export function cameraError(): string {
  if (navigator.mediaDevices && 'getUserMedia' in navigator.mediaDevices) return '';
  if (window.isSecureContext) return 'This browser does not let pages use a camera.';
  return (
    'Browsers let a page use the camera only over https, or on the studio’s machine. ' +
    'Start the studio with --tls-self-signed and open its https link; the browser warns once, because ' +
    'the certificate is the studio’s own.'
  );
}

function refusal(problem: unknown): string {
  if (problem instanceof DOMException) {
    if (problem.name === 'NotAllowedError') return 'The browser was not allowed to use the camera.';
    if (problem.name === 'NotFoundError') return 'This device has no camera.';
    if (problem.name === 'NotReadableError') return 'Another program uses the camera.';
  }
  return errorText(problem);
}

const nextFrame = (one: HTMLVideoElement) =>
  new Promise<void>((done) => {
    if ('requestVideoFrameCallback' in one) {
      // A hidden tab gets no frames: look again after a second.
      const late = setTimeout(done, 1000);
      one.requestVideoFrameCallback(() => {
        clearTimeout(late);
        done();
      });
    } else {
      setTimeout(done, 40);
    }
  });

// Asks for the camera and sends it until it is stopped. Returns the source's name.
export async function startViewerCamera(facing: 'user' | 'environment' = 'user'): Promise<string> {
  const error = cameraError();
  if (error) throw new Error(error);
  if (viewerCamera.value) return viewerCamera.value.id;
  try {
    stream = await navigator.mediaDevices.getUserMedia({
      audio: false,
      video: { facingMode: facing, width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 25 } },
    });
  } catch (problem) {
    throw new Error(refusal(problem));
  }
  let id: string;
  try {
    video = document.createElement('video');
    video.muted = true;
    video.playsInline = true;
    video.srcObject = stream;
    await video.play();
    id = await api.addViewerCamera();
  } catch (problem) {
    release();
    throw problem;
  }
  const round = ++running;
  viewerCamera.value = { id, width: 0, height: 0, sent: 0, fps: 0, problem: '' };
  stream.getVideoTracks()[0]?.addEventListener('ended', () => {
    if (running === round) void stopViewerCamera();
  });
  void send(id, video, round);
  return id;
}

async function send(id: string, from: HTMLVideoElement, round: number): Promise<void> {
  const canvas = document.createElement('canvas');
  const times: number[] = [];
  let sent = 0;
  while (running === round) {
    await nextFrame(from);
    if (running !== round) return;
    if (from.videoWidth === 0) continue;
    if (canvas.width !== from.videoWidth || canvas.height !== from.videoHeight) {
      canvas.width = from.videoWidth;
      canvas.height = from.videoHeight;
    }
    canvas.getContext('2d', { alpha: false })?.drawImage(from, 0, 0);
    const jpeg = await new Promise<Blob | null>((done) => canvas.toBlob(done, 'image/jpeg', 0.8));
    if (!jpeg) continue;
    let problem = '';
    try {
      await api.sendViewerFrame(id, jpeg);
      sent += 1;
    } catch (wrong) {
      problem = errorText(wrong);
      await new Promise((done) => setTimeout(done, 1000));
    }
    if (running !== round) return;
    const now = performance.now();
    times.push(now);
    while (now - (times[0] as number) > 2000) times.shift();
    const fps = times.length > 1 ? ((times.length - 1) * 1000) / (now - (times[0] as number)) : 0;
    viewerCamera.value = { id, width: canvas.width, height: canvas.height, sent, fps, problem };
  }
}

function release(): void {
  for (const track of stream?.getTracks() ?? []) track.stop();
  stream = undefined;
  if (video) video.srcObject = null;
  video = undefined;
}

export async function stopViewerCamera(): Promise<void> {
  running += 1;
  const id = viewerCamera.value?.id;
  viewerCamera.value = undefined;
  release();
  if (id !== undefined) await api.removeViewerCamera(id).catch(() => undefined);
}
