import { useSignalValue } from '../hooks';
import { stopViewerCamera, viewerCamera } from '../viewer_camera';
import { AsyncButton } from './controls';

// Says on every page that this device's camera is being sent, and stops it.
export function CameraBar() {
  const camera = useSignalValue(viewerCamera);
  if (!camera) return null;
  return (
    <div class="camera-bar" role="group" aria-label="Your camera">
      <span class="camera-dot" aria-hidden="true" />
      <span>
        Your camera is on
        {camera.width > 0 ? `: ${camera.width} × ${camera.height}, ${camera.fps.toFixed(0)} frames/s` : ''}
        {camera.problem ? `. ${camera.problem}` : ''}
      </span>
      <AsyncButton small run={stopViewerCamera}>
        Stop it
      </AsyncButton>
    </div>
  );
}
