// Images become cameras and a cloud of points.
import { useEffect, useRef, useState } from 'preact/hooks';
import { api, verbHelp, type Flags, type Job, type VerbHelp } from '../../api';
import { useJobs, useSignalValue } from '../../hooks';
import { navigate, route } from '../../router';
import { AsyncButton, Button, JobCard, Notice, PageHead, Select } from '../../ui';
import { attempt } from '../../ui/toast';
import { FlagFields } from '../../ui/verb_form';
import { finishJob, isOver, useJob } from '../shared/jobs';
import { SessionActions, SessionPanel, SetImages, SetSource } from '../shared/parts';
import { useAreaSession } from '../shared/sessions';
import { ModelView } from './model_view';

const offered = [
  '--features',
  '--max-features',
  '--pairs',
  '--matches',
  '--downscale',
  '--camera',
  '--refine',
  '--ignore-exif',
  '--min-views',
  '--export',
];

// What is made of the images; each takes what stands above it along.
const results = {
  points: { label: 'cameras and sparse points', flags: {} },
  dense: { label: 'also a dense cloud', flags: { '--dense': true } },
  surface: { label: 'also a textured surface', flags: { '--mesh': true } },
} as const;
type Results = keyof typeof results;

async function reconstruct(input: string, flags: Flags, name: string): Promise<Job> {
  return api.startJob({
    verb: 'sfm reconstruct',
    inputs: [input],
    flags: { ...flags, '--output': 'out:model' },
    name,
  });
}

export function Reconstruct() {
  const where = useSignalValue(route);
  const chosen = where.query.get('job') ?? undefined;
  const all = useJobs((job) => job.verb === 'sfm reconstruct');
  const job = useJob(chosen);
  const [set, setSet] = useState<{ name: string; files: number } | null>(null);
  const [flags, setFlags] = useState<Flags>({});
  const [valid, setValid] = useState(true);
  const [make, setMake] = useState<Results>('points');
  const [quality, setQuality] = useState('normal');
  const [verb, setVerb] = useState<VerbHelp>();
  const [drawing, setDrawing] = useState(false);
  const growing = useAreaSession('sfm reconstruct');
  const [grown, setGrown] = useState<string | null>(null);
  const [imagesOf, setImagesOf] = useState(11);
  useEffect(() => {
    verbHelp().then(
      (help) => setVerb(help.verbs.find((one) => one.verb === 'sfm reconstruct')),
      () => undefined,
    );
  }, []);
  // Whoever went to another page meanwhile stays there.
  const open = (id: string) => {
    if (route.peek().page === 'reconstruct') navigate(`/reconstruct?job=${encodeURIComponent(id)}`, true);
  };
  const start = async (input: string, name: string) => {
    const extra = make === 'points' ? {} : { ...results[make].flags, '--dense-quality': quality };
    const started = await attempt(() => reconstruct(input, { ...flags, ...extra }, name));
    if (started) {
      all.again();
      open(started.id);
    }
  };
  const synthetic = async () => {
    setDrawing(true);
    await attempt(async () => {
      const scene = await finishJob({
        verb: 'sfm synth',
        inputs: [],
        flags: { '--output': 'out:scene', '--images': imagesOf, '--size': '640x480' },
        name: 'Synthetic images',
      });
      await start(`job:${scene.id}/scene/images`, `${imagesOf} synthetic images`);
    });
    setDrawing(false);
  };
  // The model grows image by image in a live session; what it leaves is only to be looked at.
  const watch = async (input: string) => {
    setGrown(input);
    await growing.start([input], { '--online': true, '--output': 'ws:growing' }, 'Live reconstruction');
  };
  // The card of the first page: one click to a first model. Once, also where the page is loaded again.
  const begun = useRef(false);
  useEffect(() => {
    if (where.query.get('try') !== 'synthetic' || begun.current) return;
    begun.current = true;
    navigate('/reconstruct', true);
    void synthetic();
  }, [where]);
  const done =
    job !== undefined &&
    (job.state === 'done' || (isOver(job) && job.files.some((f) => f.name.endsWith('report.json'))));
  return (
    <>
      <PageHead
        title="Reconstruct"
        text="Computes camera poses and a point cloud from images of one object or place, taken from several sides."
      />
      {growing.id !== undefined && (
        <section class="split split-wide" aria-label="Live reconstruction">
          <SessionPanel id={growing.id} title="The model during the reconstruction" onEnd={growing.end} />
          <div class="stack">
            <p>
              Left: the current image with the model points that it observes. Right: the point cloud and the
              cameras. Consecutive images should overlap, as in a walk around the object.
            </p>
            <SessionActions id={growing.id} label="View" without={['quit', 'help']} />
            {grown !== null && (
              <AsyncButton
                kind="main"
                run={async () => {
                  await growing.end();
                  await start(grown, 'Images of the live reconstruction');
                }}
              >
                Reconstruct from all images
              </AsyncButton>
            )}
          </div>
        </section>
      )}
      {drawing && job === undefined && (
        <Notice>
          {imagesOf} images of a synthetic scene are being generated. Their model is computed next and shown
          here.
        </Notice>
      )}
      {job && done && <ModelView key={job.id} job={job} />}
      <div class="split">
        <section class="card stack" aria-labelledby="new-model">
          <h2 id="new-model">New model</h2>
          <SetSource
            kind="photos"
            label="Drop images here"
            help="8 to 60 images. Move the camera between images, do not only rotate it. Consecutive images should show mostly the same area."
            onSet={(name, files) => setSet({ name, files })}
          />
          {set && (
            <>
              <p>
                <strong>{set.files} images</strong> in {set.name}
              </p>
              <details>
                <summary>Show images</summary>
                <SetImages set={set.name} most={60} />
              </details>
            </>
          )}
          <Select
            label="Result"
            value={make}
            options={Object.entries(results).map(([value, { label }]) => ({ value, label }))}
            onChange={(value) => setMake(value as Results)}
            help="A dense cloud or a surface takes a few more minutes."
          />
          {make !== 'points' && (
            <Select
              label="Detail"
              value={quality}
              options={[
                { value: 'draft', label: 'draft: a quarter of the image size, fastest' },
                { value: 'normal', label: 'normal: half of the image size' },
                { value: 'high', label: 'high: full image size, slowest' },
              ]}
              onChange={setQuality}
            />
          )}
          {verb && (
            <details>
              <summary>Options</summary>
              <FlagFields
                verb={verb}
                options={{ only: offered }}
                onChange={(next, good) => {
                  setFlags(next);
                  setValid(good);
                }}
              />
            </details>
          )}
          <div class="row">
            <AsyncButton
              kind="main"
              disabled={set === null || set.files < 2 || !valid}
              run={async () => {
                if (set) await start(`set:${set.name}`, `${set.files} images, ${set.name}`);
              }}
            >
              Reconstruct
            </AsyncButton>
            <AsyncButton
              disabled={set === null || set.files < 2 || !valid}
              run={async () => {
                if (set) await watch(`set:${set.name}`);
              }}
            >
              Reconstruct live
            </AsyncButton>
          </div>
          <hr />
          <h3>No images?</h3>
          <Select
            label="Synthetic images"
            value={String(imagesOf)}
            options={[8, 11, 20, 40].map((n) => ({
              value: String(n),
              label: `${n} images of a synthetic scene`,
            }))}
            onChange={(value) => setImagesOf(Number(value))}
          />
          <Button busy={drawing} onClick={() => void synthetic()}>
            Try with synthetic data
          </Button>
        </section>
        <section class="stack" aria-labelledby="models">
          <h2 id="models">Models</h2>
          {all.error && <Notice kind="problem">{all.error}</Notice>}
          {all.jobs.length === 0 && !all.loading && <p class="faint">No models yet.</p>}
          {job && <JobCard job={job} files={false} onChange={all.again} />}
          {all.jobs.length > 0 && (
            <ul class="plain-list" aria-label="All models">
              {all.jobs.map((one) => (
                <li key={one.id}>
                  <a
                    href={`/reconstruct?job=${encodeURIComponent(one.id)}`}
                    aria-current={one.id === chosen ? 'true' : undefined}
                  >
                    {one.name || one.id}
                  </a>{' '}
                  <span class="faint">{one.state}</span>
                </li>
              ))}
            </ul>
          )}
        </section>
      </div>
    </>
  );
}
