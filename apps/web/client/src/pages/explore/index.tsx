// Plays with models: what each mode of shape and look does, what a patch sees.
import { useState } from 'preact/hooks';
import { api, type Flags } from '../../api';
import { useJobs, useLoad } from '../../hooks';
import { AsyncButton, PageHead, Select } from '../../ui';
import { annotations } from '../annotate/files';
import {
  SessionActions,
  SessionPanel,
  SessionSliders,
  SetSource,
  StateList,
  useSessionState,
} from '../shared/parts';
import { useAreaSession } from '../shared/sessions';

const ships = { appearance: '', points: 'model:landmarks68' };

export function Explore() {
  const aam = useAreaSession('aam explore');
  const show = useAreaSession('landmarks show');
  const session = aam.id !== undefined ? aam : show;
  const [what, setWhat] = useState('appearance');
  const [model, setModel] = useState('');
  const [on, setOn] = useState('');
  const images = useLoad(async () => {
    const sets = (await api.sets()).filter((one) => one.files > 0).slice(0, 8);
    const all = await Promise.all(
      sets.map(async (set) =>
        (await api.setFiles(set.name))
          .filter((file) => file.kind === 'image')
          .slice(0, 20)
          .map((file) => `set:${set.name}/${file.name}`),
      ),
    );
    return all.flat();
  });
  const trained = useJobs(
    (job) =>
      job.state === 'done' &&
      ['aam train', 'landmarks train tracker', 'landmarks train shape'].includes(job.verb),
  );
  const files = useLoad(async () => {
    const all = await Promise.all(
      trained.jobs.slice(0, 20).map((job) => ((job.files ?? []).length > 0 ? job : api.job(job.id))),
    );
    return all.flatMap((job) =>
      (job.files ?? [])
        .filter((file) => file.name.endsWith('.json') && !file.name.includes('/'))
        .map((file) => ({
          verb: job.verb,
          value: `job:${job.id}/${file.name}`,
          label: `${job.name || job.verb}, ${job.id}`,
        })),
    );
  }, [trained.jobs.map((job) => job.id).join(' ')]);
  const sets = useLoad(annotations);
  const isAppearance = what === 'appearance';
  const models = isAppearance
    ? [
        { value: '', label: 'Shipped face model' },
        ...(files.value ?? []).filter((one) => one.verb === 'aam train'),
      ]
    : [
        { value: '', label: 'Shipped 68-point tracker' },
        ...(files.value ?? []).filter((one) => one.verb !== 'aam train'),
        ...(sets.value ?? []).map((one) => ({ value: `ws:${one.name}`, label: `Annotation ${one.name}` })),
      ];
  const start = async (image: string) => {
    const flags: Flags = image === '' ? {} : { '--on': image };
    if (isAppearance) await aam.start(model === '' ? [] : [model], flags, 'Explore: appearance');
    else await show.start([model === '' ? ships.points : model], flags, 'Explore: points');
  };
  return (
    <>
      <PageHead title="Explore" text="Move the sliders of a model to see the effect of each parameter." />
      {session.id !== undefined ? (
        <Exploring id={session.id} onEnd={session.end} />
      ) : (
        <section class="card stack" aria-labelledby="what-to-explore">
          <h2 id="what-to-explore">Model to explore</h2>
          <Select
            label="Kind"
            value={what}
            options={[
              { value: 'appearance', label: 'appearance: shape and texture of a face' },
              { value: 'points', label: 'points: what the tracker expects around each point' },
            ]}
            onChange={(value) => {
              setWhat(value);
              setModel('');
            }}
          />
          <Select label="Model" value={model} options={models} onChange={setModel} />
          <Select
            label="Image"
            value={on}
            options={[
              { value: '', label: 'none' },
              ...(images.value ?? []).map((one) => ({ value: one, label: one.replace(/^set:/, '') })),
            ]}
            onChange={setOn}
            help="The model is fitted to the face in the image. The sliders then change that face."
          />
          <SetSource
            kind="explore"
            label="Or drop an image of a face"
            onSet={async (set) => {
              const first = (await api.setFiles(set)).find((file) => file.kind === 'image');
              if (first) setOn(`set:${set}/${first.name}`);
              images.again();
            }}
          />
          <div class="row">
            <AsyncButton kind="main" run={() => start(on)}>
              Explore
            </AsyncButton>
            <AsyncButton run={() => start('')}>Try with synthetic data</AsyncButton>
          </div>
          <p class="field-help">Without an image the model draws synthetic faces.</p>
        </section>
      )}
    </>
  );
}

function Exploring(props: { id: string; onEnd: () => Promise<void> }) {
  const state = useSessionState(props.id);
  const response = typeof state.response === 'number' ? state.response : null;
  return (
    <div class="split split-wide exploring">
      <SessionPanel id={props.id} title="Image drawn by the model" onEnd={props.onEnd} />
      <div class="stack">
        <SessionActions id={props.id} label="Actions" without={['quit', 'help', 'pause', 'fullscreen']} />
        <SessionSliders id={props.id} />
        <StateList
          state={state}
          names={{
            mode: 'Mode',
            image: 'Image',
          }}
        />
        {typeof state.patch === 'number' && (
          <p class="numbers">
            Patch {state.patch + 1} of {state.patches}
          </p>
        )}
        {response !== null && <p class="numbers">Response at the best position: {response.toFixed(3)}</p>}
      </div>
    </div>
  );
}
