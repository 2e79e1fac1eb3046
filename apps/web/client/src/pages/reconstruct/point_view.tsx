// A point of the model in its images.
import { api, type Job } from '../../api';
import { Table } from '../../ui';
import { observationsOf, type Observation } from './colmap';
import type { Model } from './model';

// Where an image of the model can be seen: beside the job's input.
function imageAddress(job: Job, name: string): string | null {
  const inputs = (job as Job & { inputs?: string[] }).inputs ?? [];
  const input = inputs[0] ?? '';
  if (input.startsWith('set:')) {
    const [set, ...rest] = input.slice(4).split('/');
    if (set && rest.length === 0) return api.setFileAddress(set, name);
  }
  const found = /^job:([^/]+)\/(.+)$/.exec(input);
  if (found) return api.jobFileAddress(found[1]!, `${found[2]!}/${name}`);
  return null;
}

const half = 36; // px of the image around the point

export function PointView({ job, model, index }: { job: Job; model: Model; index: number }) {
  const seen = observationsOf(index, model.cloud, model.images, model.cameras);
  const [x, y, z] = [0, 1, 2].map((axis) => model.cloud.positions[3 * index + axis]!.toPrecision(4));
  return (
    <section class="point-view stack" aria-live="polite" aria-label="The point in the images">
      <h3>
        Point {index + 1}: observed in {seen.length} images, at {x}, {y}, {z}
      </h3>
      <p class="field-help">The cross is the observation. The circle is the projection of the 3D point.</p>
      <ul class="thumbs">
        {seen.slice(0, 12).map((one) => (
          <li key={one.image.id}>
            <Crop job={job} model={model} one={one} />
            <span>
              {one.image.name}: {one.error === null ? 'unknown error' : `error ${one.error.toFixed(2)} px`}
            </span>
          </li>
        ))}
      </ul>
      <Table
        caption="Observations, largest error first"
        columns={[
          { name: 'Image', show: (one: Observation) => one.image.name },
          {
            name: 'Observation, px',
            show: (one) => one.seen.map((v) => v.toFixed(1)).join(', '),
            number: true,
          },
          {
            name: 'Projection, px',
            show: (one) => (one.projected ? one.projected.map((v) => v.toFixed(1)).join(', ') : ''),
            number: true,
          },
          { name: 'Error, px', show: (one) => one.error?.toFixed(2) ?? '', number: true },
        ]}
        rows={seen}
        keyOf={(one) => one.image.id}
      />
    </section>
  );
}

function Crop({ job, model, one }: { job: Job; model: Model; one: Observation }) {
  const address = imageAddress(job, one.image.name);
  const camera = model.cameras.get(one.image.camera);
  const [x, y] = one.seen;
  if (!address || !camera) return <p class="faint">no image</p>;
  return (
    <svg
      class="crop"
      viewBox={`${x - half} ${y - half} ${2 * half} ${2 * half}`}
      role="img"
      aria-label={`The point in ${one.image.name}`}
    >
      {/* Pixels are those of the sensor: not turned as EXIF asks. */}
      <image
        href={address}
        x={0}
        y={0}
        width={camera.width}
        height={camera.height}
        style="image-orientation: none"
      />
      <path class="crop-seen" d={`M${x - 6} ${y}h4m4 0h4M${x} ${y - 6}v4m0 4v4`} />
      {one.projected && <circle class="crop-model" cx={one.projected[0]} cy={one.projected[1]} r={5} />}
    </svg>
  );
}
