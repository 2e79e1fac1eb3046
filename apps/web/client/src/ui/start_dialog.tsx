// Choose what runs, on which source, with which flags; then it starts.
import { useMemo, useState } from 'preact/hooks';
import { api, verbHelp, type Flags, type Session, type Source, type VerbHelp } from '../api';
import { commandText } from '../forms';
import { useLoad } from '../hooks';
import { navigate } from '../router';
import { TRIALS } from '../areas';
import { cameraError, startViewerCamera } from '../viewer_camera';
import { AsyncButton, CommandLine, Dialog, Notice, Select } from './controls';
import { attempt } from './toast';
import { FlagFields } from './verb_form';

export const OWN_CAMERA = 'own-camera';
const OWN_CAMERA_BACK = 'own-camera-back';

// Verbs that show a window and take a source need no file first.
export function liveVerbs(verbs: VerbHelp[]): VerbHelp[] {
  return verbs.filter(
    (verb) =>
      verb.flags.some((flag) => flag.names.includes('--window') && flag.type === 'switch') &&
      verb.inputs.length === 1 &&
      verb.inputs[0]?.required === true &&
      !verb.flags.some((flag) => flag.required) &&
      !['sfm reconstruct', 'landmarks show'].includes(verb.verb),
  );
}

// Starts a session and goes to its page. "own-camera" among the inputs asks for the viewer's camera first.
export async function startAndOpen(request: {
  verb: string;
  inputs: string[];
  flags: Flags;
}): Promise<Session | undefined> {
  return attempt(async () => {
    const inputs: string[] = [];
    for (const input of request.inputs) {
      if (input === OWN_CAMERA) inputs.push(await startViewerCamera('user'));
      else if (input === OWN_CAMERA_BACK) inputs.push(await startViewerCamera('environment'));
      else inputs.push(input);
    }
    const session = await api.startSession({ ...request, inputs });
    navigate(`/session/${session.id}`);
    return session;
  });
}

const KINDS: Record<Source['kind'], string> = {
  camera: 'Cameras of the studio’s machine',
  allowed: 'Allowed sources',
  viewer: 'Cameras of viewers',
  synth: 'Synthetic',
  file: 'Uploaded sets',
};

// A list of all sources, the viewer's own camera among them.
export function SourceSelect(props: {
  label?: string;
  value: string;
  onChange: (id: string) => void;
  sets?: boolean;
  live?: boolean;
}) {
  const sources = useLoad(api.sources);
  const sets = useLoad(async () => (props.sets ? api.sets() : []));
  const options = (sources.value ?? [])
    .filter((source) => props.live !== true || source.live)
    .map((source) => ({ value: source.id, label: source.name, group: KINDS[source.kind] ?? source.kind }));
  options.sort((a, b) => Object.values(KINDS).indexOf(a.group) - Object.values(KINDS).indexOf(b.group));
  options.push({ value: OWN_CAMERA, label: 'My camera', group: 'This device' });
  options.push({ value: OWN_CAMERA_BACK, label: 'My rear camera', group: 'This device' });
  for (const set of sets.value ?? []) {
    if (options.some((option) => option.value === `set:${set.name}`)) continue;
    options.push({
      value: `set:${set.name}`,
      label: `${set.name}, ${set.files} files`,
      group: 'Uploaded sets',
    });
  }
  if (!options.some((option) => option.value === props.value)) {
    options.unshift({ value: props.value, label: props.value || 'Choose', group: '' });
  }
  return (
    <>
      <Select
        label={props.label ?? 'Source'}
        value={props.value}
        options={options}
        onChange={props.onChange}
        problem={sources.error}
      />
      {props.value.startsWith(OWN_CAMERA) && cameraError() && <Notice>{cameraError()}</Notice>}
    </>
  );
}

export function StartDialog(props: { open: boolean; onClose: () => void; verb?: string; source?: string }) {
  return (
    <Dialog title="Start a session" open={props.open} onClose={props.onClose} wide>
      <StartForm verb={props.verb} source={props.source} onStarted={props.onClose} />
    </Dialog>
  );
}

function StartForm(props: { verb?: string; source?: string; onStarted: () => void }) {
  const help = useLoad(verbHelp);
  const [chosen, setChosen] = useState(props.verb ?? 'cartoon run');
  const [source, setSource] = useState(props.source ?? '');
  const [flags, setFlags] = useState<Flags>({});
  const [valid, setValid] = useState(true);
  const verbs = useMemo(() => liveVerbs(help.value?.verbs ?? []), [help.value]);
  const verb = verbs.find((one) => one.verb === chosen);
  const trial = TRIALS.find((one) => one.verb === chosen);
  const input = source || trial?.inputs[0] || 'synth:scene?live=1';
  if (help.error) return <Notice kind="problem">{help.error}</Notice>;
  if (!help.value) return <p class="faint">Loading</p>;
  return (
    <form onSubmit={(event) => event.preventDefault()}>
      <div class="fields">
        <Select
          label="Verb"
          value={chosen}
          options={verbs.map((one) => ({
            value: one.verb,
            label: `${one.verb}: ${one.help}`,
            group: one.area,
          }))}
          onChange={(next) => {
            setChosen(next);
            setFlags({});
            setValid(true);
          }}
        />
        <SourceSelect value={input} onChange={setSource} sets />
      </div>
      {verb && (
        <details>
          <summary>Settings</summary>
          <FlagFields
            key={chosen}
            verb={verb}
            start={trial?.flags}
            onChange={(next, good) => {
              setFlags(next);
              setValid(good);
            }}
          />
        </details>
      )}
      <CommandLine
        text={commandText(chosen, [input], { ...trial?.flags, ...flags })}
        label="The same in a terminal"
      />
      <div class="row row-end">
        <AsyncButton
          kind="main"
          type="submit"
          disabled={!valid || !verb}
          run={async () => {
            const session = await startAndOpen({
              verb: chosen,
              inputs: [input],
              flags: { ...trial?.flags, ...flags },
            });
            if (session) props.onStarted();
          }}
        >
          Start
        </AsyncButton>
      </div>
    </form>
  );
}
