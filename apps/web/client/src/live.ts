// The one long-lived response of a visible tab: images, states and jobs.
import { signal, type Signal } from '@preact/signals';
import { call, signedIn, type Hello, type Job, type LiveState } from './api';
import { WHOLE, widest } from './image_size';

export const KIND = { image: 1, state: 2, hello: 3, job: 4, ping: 5, ended: 6 } as const;

export interface LiveRecord {
  kind: number;
  id: string;
  payload: Uint8Array;
}

const MAX_RECORD = 64 * 1024 * 1024;

// Cuts a stream of bytes, in pieces of any size, into records:
// u32 big-endian length of what follows, u8 kind, u8 n, n bytes of id, payload.
// Throws on a record that cannot be.
export class LiveParser {
  private pieces: Uint8Array[] = [];
  private held = 0;

  push(piece: Uint8Array): LiveRecord[] {
    if (piece.length > 0) {
      this.pieces.push(piece);
      this.held += piece.length;
    }
    const records: LiveRecord[] = [];
    for (;;) {
      if (this.held < 4) break;
      const head = this.peek(4);
      const length = new DataView(head.buffer, head.byteOffset, 4).getUint32(0);
      if (length < 2 || length > MAX_RECORD) throw new Error(`a live record of ${length} bytes`);
      if (this.held < 4 + length) break;
      const whole = this.take(4 + length);
      const kind = whole[4] as number;
      const n = whole[5] as number;
      if (6 + n > whole.length) throw new Error('a live record whose id is longer than the record');
      const id = new TextDecoder().decode(whole.subarray(6, 6 + n));
      records.push({ kind, id, payload: whole.subarray(6 + n) });
    }
    return records;
  }

  // The first `count` bytes as one array; the pieces are joined only as far as needed.
  private peek(count: number): Uint8Array {
    const first = this.pieces[0] as Uint8Array;
    if (first.length >= count) return first;
    const joined = this.take(count);
    this.pieces.unshift(joined);
    this.held += joined.length;
    return joined;
  }

  private take(count: number): Uint8Array {
    const first = this.pieces[0] as Uint8Array;
    this.held -= count;
    if (first.length === count) {
      this.pieces.shift();
      return first;
    }
    if (first.length > count) {
      this.pieces[0] = first.subarray(count);
      return first.subarray(0, count);
    }
    const joined = new Uint8Array(count);
    let at = 0;
    while (at < count) {
      const piece = this.pieces[0] as Uint8Array;
      const part = Math.min(piece.length, count - at);
      joined.set(part === piece.length ? piece : piece.subarray(0, part), at);
      at += part;
      if (part === piece.length) this.pieces.shift();
      else this.pieces[0] = piece.subarray(part);
    }
    return joined;
  }
}

export interface LiveImage {
  frame: number;
  ageMs: number; // when the server sent it
  jpeg: Uint8Array;
}

export function imageOf(payload: Uint8Array): LiveImage {
  if (payload.length < 8) throw new Error('a live image without its head');
  const view = new DataView(payload.buffer, payload.byteOffset, payload.byteLength);
  return { frame: view.getUint32(0), ageMs: view.getUint32(4), jpeg: payload.subarray(8) };
}

// Seconds to wait before the n-th try to connect again: 0.5, 1, 2, 4, 8, 8 ..
export function backOff(tries: number): number {
  return Math.min(8, 0.5 * 2 ** Math.max(0, tries));
}

// What is known live of one session.
export interface LiveSession {
  hello: Signal<Hello | undefined>;
  state: Signal<LiveState | undefined>;
  ended: Signal<{ exit: number | null; error: string | null } | undefined>;
  shown: Signal<{ frame: number; ageMs: number; fps: number }>;
}

interface Watched extends LiveSession {
  watchers: number;
  painters: Map<Paint, number>; // each with the width that it wants
  decoding: boolean;
  next: LiveImage | undefined;
  times: number[];
}

export type Paint = (bitmap: ImageBitmap) => void;

export type LiveLink = 'idle' | 'connecting' | 'open' | 'waiting';

export const liveLink = signal<LiveLink>('idle');
// Jobs by id, as they change while somebody watches.
export const liveJobs = signal<ReadonlyMap<string, Job>>(new Map());
// Ids of jobs that were removed meanwhile.
export const removedJobs = signal<ReadonlySet<string>>(new Set());

const sessions = new Map<string, Watched>();
let jobWatchers = 0;
let controller: AbortController | undefined;
let wantedNow = '';
let tries = 0;
let timer: ReturnType<typeof setTimeout> | undefined;

function sessionOf(id: string): Watched {
  let one = sessions.get(id);
  if (!one) {
    one = {
      hello: signal(undefined),
      state: signal(undefined),
      ended: signal(undefined),
      shown: signal({ frame: 0, ageMs: 0, fps: 0 }),
      watchers: 0,
      painters: new Map(),
      decoding: false,
      next: undefined,
      times: [],
    };
    sessions.set(id, one);
  }
  return one;
}

export function liveSession(id: string): LiveSession {
  return sessionOf(id);
}

// Follows a session until the function returned is called. `width`: px, as wide as images are shown.
export function watchSession(id: string, paint?: Paint, width = WHOLE): () => void {
  const one = sessionOf(id);
  one.watchers += 1;
  if (paint) one.painters.set(paint, width);
  scheduleUpdate();
  return () => {
    one.watchers -= 1;
    if (paint) one.painters.delete(paint);
    if (one.watchers === 0) sessions.delete(id);
    scheduleUpdate();
  };
}

// The place of these images has another size now.
export function setImageWidth(id: string, paint: Paint, width: number): void {
  const one = sessions.get(id);
  if (!one || !one.painters.has(paint) || one.painters.get(paint) === width) return;
  one.painters.set(paint, width);
  scheduleUpdate();
}

export function watchJobs(): () => void {
  jobWatchers += 1;
  scheduleUpdate();
  return () => {
    jobWatchers -= 1;
    scheduleUpdate();
  };
}

function streamAddress(): string {
  if (document.visibilityState === 'hidden' || signedIn.value !== true) return '';
  const ids = [...sessions.entries()]
    .filter(([, one]) => one.watchers > 0 && one.ended.value === undefined)
    .map(([id, one]) => {
      const width = widest(one.painters.values());
      return encodeURIComponent(id) + (width === WHOLE ? '' : `:${width}`);
    })
    .sort();
  if (ids.length === 0 && jobWatchers === 0) return '';
  const words = [];
  if (ids.length > 0) words.push(`s=${ids.join(',')}`);
  if (jobWatchers > 0) words.push('jobs=1');
  return `/api/live?${words.join('&')}`;
}

let pending = false;
// Pages change what they watch in bursts: one new connection for all of it.
function scheduleUpdate(): void {
  if (pending) return;
  pending = true;
  setTimeout(() => {
    pending = false;
    update();
  }, 30);
}

function update(): void {
  const address = streamAddress();
  if (address === wantedNow && (address === '' || controller)) return;
  wantedNow = address;
  controller?.abort();
  controller = undefined;
  clearTimeout(timer);
  if (address === '') {
    liveLink.value = 'idle';
    return;
  }
  tries = 0;
  void connect(address);
}

async function connect(address: string): Promise<void> {
  const own = new AbortController();
  controller = own;
  if (liveLink.value !== 'waiting') liveLink.value = 'connecting';
  let heard = Date.now();
  // The server pings each 2 s. Silence means that the line is dead.
  const watchdog = setInterval(() => {
    if (Date.now() - heard > 10_000) own.abort();
  }, 2000);
  try {
    const response = await call(address, { signal: own.signal });
    if (!response.body) throw new Error('the browser does not support streamed responses');
    const reader = response.body.getReader();
    const parser = new LiveParser();
    liveLink.value = 'open';
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      heard = Date.now();
      tries = 0;
      for (const record of parser.push(value)) take(record);
    }
  } catch {
    // Said below by the state of the link.
  } finally {
    clearInterval(watchdog);
  }
  if (controller !== own) return;
  controller = undefined;
  const next = streamAddress();
  if (next === '') {
    wantedNow = '';
    liveLink.value = 'idle';
    return;
  }
  wantedNow = next;
  // One short break is not worth a word.
  liveLink.value = tries > 0 ? 'waiting' : 'connecting';
  timer = setTimeout(() => void connect(next), backOff(tries) * 1000);
  tries += 1;
}

function text<T>(payload: Uint8Array): T {
  return JSON.parse(new TextDecoder().decode(payload)) as T;
}

function takeJob(job: Job | { id: string; state: 'deleted' }): void {
  const jobs = new Map(liveJobs.value);
  if (job.state === 'deleted') {
    jobs.delete(job.id);
    removedJobs.value = new Set(removedJobs.value).add(job.id);
  } else {
    jobs.set(job.id, job);
  }
  liveJobs.value = jobs;
}

export function take(record: LiveRecord): void {
  if (record.kind === KIND.ping) return;
  if (record.kind === KIND.job) {
    takeJob(text(record.payload));
    return;
  }
  const one = sessions.get(record.id);
  if (!one) return;
  if (record.kind === KIND.image) {
    one.next = imageOf(record.payload);
    void decode(one);
  } else if (record.kind === KIND.state) {
    one.state.value = text<LiveState>(record.payload);
  } else if (record.kind === KIND.hello) {
    one.hello.value = text<Hello>(record.payload);
  } else if (record.kind === KIND.ended) {
    one.ended.value = text<{ exit: number | null; error: string | null }>(record.payload);
  }
}

// One image is decoded at a time; only the newest waits.
async function decode(one: Watched): Promise<void> {
  if (one.decoding) return;
  one.decoding = true;
  while (one.next) {
    const image = one.next;
    one.next = undefined;
    const came = performance.now();
    try {
      const bitmap = await createImageBitmap(new Blob([image.jpeg as BlobPart], { type: 'image/jpeg' }));
      for (const paint of one.painters.keys()) paint(bitmap);
      bitmap.close();
      const now = performance.now();
      one.times = one.times.filter((time) => now - time < 2000);
      // A paused session, or one that is drawn again, shows the same frame: no frame rate.
      if (image.frame !== one.shown.peek().frame) one.times.push(now);
      const span = now - (one.times[0] ?? now);
      const fps = one.times.length > 1 && span > 0 ? ((one.times.length - 1) * 1000) / span : 0;
      one.shown.value = { frame: image.frame, ageMs: image.ageMs + (now - came), fps };
    } catch {
      // An image that cannot be decoded is left out; the next one comes.
    }
  }
  one.decoding = false;
}

export function startLive(): void {
  document.addEventListener('visibilitychange', scheduleUpdate);
  signedIn.subscribe(scheduleUpdate);
  window.addEventListener('pagehide', () => controller?.abort());
  window.addEventListener('pageshow', scheduleUpdate);
}
