// Parts that the area pages share.
import { useEffect, useState } from 'preact/hooks';
import { api, type Flags, type Json, type SetInfo, type Source } from '../../api';
import { actionTitle, cellText } from '../../format';
import { useLoad, useSignalValue } from '../../hooks';
import { keyOf, ownKeys } from '../../key_map';
import { keyName } from '../../keys';
import { liveSession } from '../../live';
import { Button, CommandLine, FileDrop, LiveStatus, LiveView, Notice, Progress, Select } from '../../ui';
import { sendEvent } from '../../ui/live_view';
import { attempt } from '../../ui/toast';
import { cameraError } from '../../viewer_camera';
import { ownCamera, ownCameraBack } from './sessions';
import { GroupedSliders } from './sliders';
import { cleanName, setName, uploadAll, type UploadState } from './files';

const kindNames: Record<Source['kind'], string> = {
  synth: 'Synthetic',
  camera: 'Cameras of the studio’s machine',
  allowed: 'Allowed sources',
  viewer: 'Cameras of viewers',
  file: 'Uploaded sets',
};

// One of the sources that the server knows. The page's own synthetic source comes first.
export function SourceSelect(props: {
  label: string;
  value: string;
  onChange: (id: string) => void;
  own?: { id: string; name: string };
  help?: string;
  only?: (source: Source) => boolean;
}) {
  const sources = useLoad(api.sources);
  const all = (sources.value ?? []).filter((one) => one.id !== props.own?.id && (props.only?.(one) ?? true));
  const options = all.map((one) => ({
    value: one.id,
    label: one.name,
    group: kindNames[one.kind] ?? 'Other',
  }));
  if (props.own) options.unshift({ value: props.own.id, label: props.own.name, group: kindNames.synth });
  options.push({ value: ownCamera, label: 'My camera', group: 'This device' });
  options.push({ value: ownCameraBack, label: 'My rear camera', group: 'This device' });
  if (props.value !== '' && !options.some((one) => one.value === props.value)) {
    options.push({ value: props.value, label: props.value, group: 'Other' });
  }
  const error = props.value.startsWith(ownCamera) ? cameraError() : '';
  return (
    <>
      <Select
        label={props.label}
        value={props.value}
        options={options}
        onChange={props.onChange}
        help={props.help}
        problem={sources.error}
      />
      {error && <Notice>{error}</Notice>}
    </>
  );
}

// Images as a set: dropped now, or a set that is there.
export function SetSource(props: {
  kind: string; // begins the name of a new set
  label: string;
  help?: string;
  accept?: string;
  onSet: (set: string, files: number) => void;
}) {
  const sets = useLoad(api.sets);
  const [upload, setUpload] = useState<UploadState | null>(null);
  const take = async (files: File[]) => {
    const name = setName(props.kind);
    await attempt(async () => {
      await api.addSet(name);
      const state = await uploadAll(
        name,
        files.map((file) => ({ name: file.name, body: file })),
        setUpload,
      );
      sets.again();
      const uploaded = state.total - state.refused.length;
      if (uploaded > 0) props.onSet(name, uploaded);
    });
  };
  const busy = upload !== null && upload.done < upload.total;
  const known = (sets.value ?? []).filter((one: SetInfo) => one.files > 0);
  return (
    <div class="stack">
      <FileDrop
        label={props.label}
        help={props.help}
        accept={props.accept ?? 'image/*'}
        multiple
        disabled={busy}
        onFiles={(files) => void take(files)}
      />
      {busy && upload && <Progress label="Uploading" done={upload.done} total={upload.total} unit="files" />}
      {upload && upload.refused.length > 0 && (
        <Notice kind="problem">
          <p>These files were rejected:</p>
          <ul>
            {upload.refused.map((one) => (
              <li key={one.name}>
                {one.name}: {one.reason}
              </li>
            ))}
          </ul>
        </Notice>
      )}
      {/* Always there, so that nothing moves when the sets become known. */}
      <Select
        label="Or an existing set"
        value=""
        options={[
          { value: '', label: known.length > 0 ? 'Choose a set' : 'No sets yet' },
          ...known.map((one) => ({ value: one.name, label: `${one.name} (${one.files} files)` })),
        ]}
        onChange={(name) => {
          const set = known.find((one) => one.name === name);
          if (set) props.onSet(set.name, set.files);
        }}
      />
    </div>
  );
}

export { cleanName };

// Small images of a set, each with its name.
export function SetImages(props: {
  set: string;
  round?: number;
  most?: number;
  onRemove?: (name: string) => void;
}) {
  const files = useLoad(() => api.setFiles(props.set), [props.set, props.round]);
  const images = (files.value ?? []).filter((file) => file.kind === 'image');
  const most = props.most ?? 24;
  return (
    <>
      <ul class="thumbs" aria-label={`Images of ${props.set}`}>
        {images.slice(0, most).map((file) => (
          <li key={file.name}>
            <img
              src={api.setFileAddress(props.set, file.name, 160)}
              alt=""
              loading="lazy"
              width={160}
              height={120}
            />
            <span>{file.name}</span>
            {props.onRemove && (
              <Button
                small
                kind="quiet"
                aria-label={`Remove ${file.name}`}
                onClick={() => props.onRemove?.(file.name)}
              >
                Remove
              </Button>
            )}
          </li>
        ))}
      </ul>
      {images.length > most && <p class="faint">and {images.length - most} more</p>}
      {files.error && <Notice kind="problem">{files.error}</Notice>}
    </>
  );
}

// The state of a session, at most once a second, so that text beside the image can be read.
export function useSessionState(id: string | undefined): { [name: string]: Json } {
  const [state, setState] = useState<{ [name: string]: Json }>({});
  useEffect(() => {
    if (id === undefined) return;
    const live = liveSession(id);
    let timer: ReturnType<typeof setTimeout> | undefined;
    let last = 0;
    const stop = live.state.subscribe((next) => {
      if (!next || timer !== undefined) return;
      const wait = Math.max(0, 250 - (performance.now() - last));
      timer = setTimeout(() => {
        timer = undefined;
        last = performance.now();
        setState(live.state.peek()?.state ?? {});
      }, wait);
    });
    return () => {
      stop();
      clearTimeout(timer);
    };
  }, [id]);
  return state;
}

// What does not change of a session: asked once for all parts of a page.
const asked = new Map<string, Promise<{ command: string; verb: string }>>();
function useSession(id: string): { command: string; verb: string } {
  const [known, setKnown] = useState({ command: '', verb: '' });
  useEffect(() => {
    let alive = true;
    let answer = asked.get(id);
    if (!answer) asked.set(id, (answer = api.sessionOf(id)));
    answer.then(
      ({ command, verb }) => {
        if (alive) setKnown({ command, verb });
      },
      () => asked.delete(id),
    );
    return () => {
      alive = false;
    };
  }, [id]);
  return known;
}
const useVerb = (id: string) => useSession(id).verb;

// The actions of a session as buttons with their keys. `names` chooses and orders them.
export function SessionActions(props: {
  id: string;
  names?: readonly string[];
  without?: readonly string[];
  label: string;
}) {
  const hello = useSignalValue(liveSession(props.id).hello);
  const own = useSignalValue(ownKeys)[useVerb(props.id)] ?? {};
  const all = hello?.actions ?? [];
  const actions = props.names
    ? props.names.flatMap((name) => all.filter((one) => one.name === name))
    : all.filter((one) => !(props.without ?? []).includes(one.name));
  if (actions.length === 0) return null;
  return (
    <div class="actions action-grid" role="group" aria-label={props.label}>
      {actions.map((action) => {
        const key = keyName(keyOf(action, own));
        return (
          <Button
            key={action.name}
            data-action={action.name}
            aria-keyshortcuts={key === '' ? undefined : key}
            onClick={() => sendEvent(props.id, { action: action.name })}
          >
            <span>{actionTitle(action)}</span>
            {key !== '' && <kbd aria-hidden="true">{key}</kbd>}
          </Button>
        );
      })}
    </div>
  );
}

export function SessionSliders(props: { id: string; names?: (name: string) => boolean }) {
  const hello = useSignalValue(liveSession(props.id).hello);
  const sliders = (hello?.sliders ?? []).filter((one) => props.names?.(one.name) ?? true);
  return <GroupedSliders id={props.id} sliders={sliders} />;
}

// Simple values of a state as a list of terms.
export function StateList(props: { state: { [name: string]: Json }; names: Record<string, string> }) {
  return (
    <dl class="state-list">
      {Object.entries(props.names)
        .filter(([name]) => name in props.state && props.state[name] !== '' && props.state[name] !== null)
        .map(([name, label]) => (
          <div key={name}>
            <dt>{label}</dt>
            <dd>{cellText(props.state[name])}</dd>
          </div>
        ))}
    </dl>
  );
}

// The image of a running session with its status line, what it is as a command, and the way out.
export function SessionPanel(props: {
  id: string;
  title: string;
  onEnd: () => Promise<void>;
  interactive?: boolean;
  drag?: boolean;
  end?: string;
}) {
  const ended = useSignalValue(liveSession(props.id).ended);
  const { command, verb } = useSession(props.id);
  return (
    <div class="session-panel">
      <LiveView
        id={props.id}
        title={props.title}
        interactive={props.interactive ?? true}
        drag={props.drag}
        verb={verb}
      />
      <LiveStatus id={props.id} />
      <div class="row">
        <Button kind={ended ? 'main' : 'plain'} onClick={() => void props.onEnd()}>
          {ended ? 'Close' : (props.end ?? 'End')}
        </Button>
        <a href={`/session/${encodeURIComponent(props.id)}`}>Open the session</a>
        <a href={api.snapshotAddress(props.id)} download="image.jpg">
          Save this image
        </a>
      </div>
      {command !== '' && (
        <details>
          <summary>The same in a terminal</summary>
          <CommandLine text={command} />
        </details>
      )}
    </div>
  );
}

// Flags without those that are empty.
export function filled(flags: Record<string, string | number | boolean | undefined>): Flags {
  const result: Flags = {};
  for (const [name, value] of Object.entries(flags)) {
    if (value !== undefined && value !== '' && value !== false) result[name] = value;
  }
  return result;
}
