import { useEffect, useRef, useState } from 'preact/hooks';
import { api, verbHelp, type Action, type Flags, type Session } from '../../api';
import { sessionName } from '../../areas';
import { actionTitle, cellText } from '../../format';
import { commandText } from '../../forms';
import { useEvery, useLoad, useSignalValue } from '../../hooks';
import { keyOf } from '../../key_map';
import { keyName } from '../../keys';
import { liveSession } from '../../live';
import { navigate, route } from '../../router';
import {
  AsyncButton,
  attempt,
  Button,
  CommandLine,
  Dialog,
  FlagFields,
  LiveStatus,
  LiveView,
  Notice,
  sendEvent,
  Table,
  Tabs,
  toast,
} from '../../ui';
import { save } from '../shared/files';
import { GroupedSliders } from '../shared/sliders';
import { LiveFigures } from '../live';
import { KeyTable, useOwnKeys } from './key_table';
import { StageStrip } from './stage_strip';

// The page has these itself, or they make no sense in a browser.
const PAGE_ACTIONS = new Set(['quit', 'help', 'fullscreen', 'save']);
const BLOCKED_KEYS: ReadonlySet<number> = new Set([27]);

// Keys that stay with the page: Escape, and those of actions that the page has itself.
function blockedKeys(actions: Action[]): ReadonlySet<number> {
  const blocked = new Set(BLOCKED_KEYS);
  for (const action of actions) if (PAGE_ACTIONS.has(action.name) && action.key > 0) blocked.add(action.key);
  for (const key of ['q', 'h', '?']) {
    const code = key.charCodeAt(0);
    if (!actions.some((action) => action.key === code && !PAGE_ACTIONS.has(action.name))) blocked.add(code);
  }
  return blocked;
}

const ownActions = (actions: Action[]) => actions.filter((action) => !PAGE_ACTIONS.has(action.name));

export function ActionButtons({ id, verb, actions }: { id: string; verb: string; actions: Action[] }) {
  const own = useOwnKeys(verb);
  const shown = ownActions(actions);
  const keyText = (action: Action) => keyName(keyOf(action, own));
  if (shown.length === 0) return null;
  return (
    <div class="actions action-grid" role="group" aria-label="Actions">
      {shown.map((action) => (
        <Button
          key={action.name}
          data-action={action.name}
          onClick={() => sendEvent(id, { action: action.name })}
        >
          <span>{actionTitle(action)}</span>
          {keyText(action) && <kbd aria-label={`key ${keyText(action)}`}>{keyText(action)}</kbd>}
        </Button>
      ))}
    </div>
  );
}

function flat(value: unknown, name = ''): { name: string; value: string }[] {
  if (value !== null && typeof value === 'object' && !Array.isArray(value)) {
    return Object.entries(value).flatMap(([key, one]) => flat(one, name ? `${name}.${key}` : key));
  }
  return [{ name, value: cellText(value) }];
}

// The state as a table or as JSON; drawn again at most twice a second.
export function StateView({ id }: { id: string }) {
  const live = liveSession(id);
  const [state, setState] = useState(live.state.peek());
  const [json, setJson] = useState(false);
  useEffect(() => {
    const timer = setInterval(() => setState(live.state.peek()), 500);
    return () => clearInterval(timer);
  }, [id]);
  const rows = flat(state?.state ?? {});
  return (
    <>
      <div class="row">
        <Button small aria-pressed={!json} onClick={() => setJson(false)}>
          Table
        </Button>
        <Button small aria-pressed={json} onClick={() => setJson(true)}>
          JSON
        </Button>
      </div>
      {json ? (
        <pre class="log" tabIndex={0} aria-label="State as JSON">
          {JSON.stringify(state?.state ?? {}, null, 2)}
        </pre>
      ) : (
        <Table
          caption="State"
          hideCaption
          columns={[
            { name: 'Field', show: (row) => row.name },
            { name: 'Value', show: (row) => row.value },
          ]}
          rows={rows}
          keyOf={(row) => row.name}
          empty="No state yet."
        />
      )}
    </>
  );
}

const stamp = () => new Date().toISOString().slice(0, 19).replaceAll(/[:T]/g, '-');

// Records what the canvas shows, as a video of the browser.
function useRecorder(canvas: { current: HTMLCanvasElement | null }, name: string) {
  const [seconds, setSeconds] = useState<number | null>(null);
  const recorder = useRef<MediaRecorder | null>(null);
  const begin = () => {
    const one = canvas.current;
    if (!one || !('captureStream' in one) || typeof MediaRecorder === 'undefined') {
      toast(
        'This browser cannot record the image. To record on the server, copy the command and add -o FILE.mp4.',
        'problem',
      );
      return;
    }
    const type = ['video/webm;codecs=vp9', 'video/webm', 'video/mp4'].find((word) =>
      MediaRecorder.isTypeSupported(word),
    );
    const parts: Blob[] = [];
    const made = new MediaRecorder(one.captureStream(25), type ? { mimeType: type } : undefined);
    made.ondataavailable = (event) => parts.push(event.data);
    made.onstop = () => {
      const ending = made.mimeType.includes('mp4') ? 'mp4' : 'webm';
      save(`${name}-${stamp()}.${ending}`, new Blob(parts, { type: made.mimeType }));
      for (const track of made.stream.getTracks()) track.stop();
    };
    made.start(1000);
    recorder.current = made;
    setSeconds(0);
  };
  const end = () => {
    recorder.current?.stop();
    recorder.current = null;
    setSeconds(null);
  };
  useEffect(() => {
    if (seconds === null) return;
    const timer = setTimeout(() => setSeconds(seconds + 1), 1000);
    return () => clearTimeout(timer);
  }, [seconds]);
  useEffect(() => () => recorder.current?.stop(), []);
  return { seconds, begin, end };
}

function ChangeFlags(props: {
  session: Session;
  open: boolean;
  onClose: () => void;
  end: () => Promise<void>;
}) {
  const { session } = props;
  const help = useLoad(verbHelp);
  const [flags, setFlags] = useState<Flags>(session.flags);
  const [valid, setValid] = useState(true);
  const verb = help.value?.verbs.find((one) => one.verb === session.verb);
  return (
    <Dialog title="Change the settings" open={props.open} onClose={props.onClose} wide>
      <p>The session restarts with these settings.</p>
      {verb && (
        <FlagFields
          verb={verb}
          start={session.flags}
          onChange={(next, good) => {
            setFlags(next);
            setValid(good);
          }}
        />
      )}
      <CommandLine text={commandText(session.verb, session.inputs, flags)} label="The same in a terminal" />
      <div class="row row-end">
        <Button onClick={props.onClose}>Cancel</Button>
        <AsyncButton
          kind="main"
          disabled={!valid || !verb}
          run={async () => {
            const next = await attempt(async () => {
              await props.end();
              return api.startSession({ verb: session.verb, inputs: session.inputs, flags });
            });
            if (next) {
              props.onClose();
              navigate(`/session/${next.id}`, true);
            }
          }}
        >
          Restart with these settings
        </AsyncButton>
      </div>
    </Dialog>
  );
}

export function SessionPage() {
  const now = useSignalValue(route);
  const id = now.rest[0] ?? '';
  return <SessionOf key={id} id={id} onlyImage={now.query.get('only') === 'image'} />;
}

function SessionOf({ id, onlyImage }: { id: string; onlyImage: boolean }) {
  const loaded = useLoad(() => api.sessionOf(id));
  const leaving = useRef(false);
  useEvery(2, () => {
    if (!leaving.current) loaded.again();
  });
  // Nothing asks for a session that is gone.
  const endSession = async () => {
    leaving.current = true;
    try {
      await api.endSession(id);
    } catch (error) {
      leaving.current = false;
      throw error;
    }
  };
  const live = liveSession(id);
  const hello = useSignalValue(live.hello);
  const ended = useSignalValue(live.ended);
  const canvas = useRef<HTMLCanvasElement | null>(null);
  const stage = useRef<HTMLDivElement>(null);
  const [tab, setTab] = useState('controls');
  const [change, setChange] = useState(false);
  const [stages, setStages] = useState(false);
  const session = loaded.value;
  const name = session ? sessionName(session) : 'Session';
  const recorder = useRecorder(canvas, session?.verb.replaceAll(' ', '-') ?? 'tarsier');
  const actions = hello?.actions ?? session?.actions ?? [];
  const sliders = hello?.sliders ?? session?.sliders ?? [];
  const blocked = blockedKeys(actions);

  if (!session) {
    return (
      <>
        <h1 tabIndex={-1}>Session</h1>
        {loaded.error ? (
          <Notice kind="problem">
            {loaded.error} <a href="/live">All sessions</a>
          </Notice>
        ) : (
          <p class="faint">Loading</p>
        )}
      </>
    );
  }

  const view = (
    <LiveView
      id={id}
      title={`Live image of ${name}`}
      interactive
      drag={session.verb.includes('annotate')}
      verb={session.verb}
      whole={recorder.seconds !== null || session.verb.includes('annotate')}
      blockedKeys={blocked}
      onCanvas={(one) => {
        canvas.current = one;
      }}
    />
  );
  if (onlyImage) {
    return (
      <div class="only-image">
        <h1 class="unseen">{name}</h1>
        {view}
        <LiveStatus id={id} />
      </div>
    );
  }

  const running = session.running && !ended;
  const hasStages = hello?.stages ?? session.stages ?? false;
  const snapshot = async () => {
    const answer = await attempt(async () => (await fetch(api.snapshotAddress(id))).blob());
    if (answer) save(`${session.verb.replaceAll(' ', '-')}-${stamp()}.jpg`, answer);
  };
  const restart = async () => {
    const next = await attempt(() =>
      api.startSession({ verb: session.verb, inputs: session.inputs, flags: session.flags }),
    );
    if (next) navigate(`/session/${next.id}`, true);
  };

  return (
    <div class="session">
      <div class={`session-image${stages ? ' has-stages' : ''}`}>
        <div class="session-head">
          <h1 tabIndex={-1}>{name}</h1>
          <span class={`chip ${running ? 'chip-running' : 'chip-bad'}`}>{running ? 'live' : 'ended'}</span>
          <LiveFigures id={id} />
        </div>
        <div class="stage" ref={stage}>
          {view}
        </div>
        <LiveStatus id={id} />
        {stages && running && <StageStrip id={id} />}
      </div>
      <div class="session-side">
        {!running && (
          <Notice kind={session.error || ended?.error ? 'problem' : 'info'}>
            <p>{ended?.error || session.error || 'The session ended.'}</p>
            <AsyncButton small run={restart}>
              Restart
            </AsyncButton>
          </Notice>
        )}
        <div class="row tools" role="group" aria-label="Image">
          <AsyncButton small run={snapshot}>
            Snapshot
          </AsyncButton>
          {recorder.seconds === null ? (
            <Button small onClick={recorder.begin} disabled={!running}>
              Record
            </Button>
          ) : (
            <Button small kind="danger" onClick={recorder.end}>
              Stop recording ({recorder.seconds} s)
            </Button>
          )}
          <Button
            small
            onClick={() =>
              window.open(`/session/${id}?only=image`, `tarsier-${id}`, 'popup,width=720,height=600')
            }
          >
            Pop out
          </Button>
          <Button small onClick={() => void attempt(async () => stage.current?.requestFullscreen())}>
            Full screen
          </Button>
          {hasStages && running && (
            <Button small aria-expanded={stages} onClick={() => setStages(!stages)}>
              Stages
            </Button>
          )}
          <Button small onClick={() => setChange(true)}>
            Settings
          </Button>
          <AsyncButton
            small
            kind="danger"
            run={async () => {
              const done = await attempt(async () => {
                await endSession();
                return true;
              });
              if (done) navigate('/live');
            }}
          >
            {running ? 'End' : 'Remove'}
          </AsyncButton>
        </div>
        <Tabs
          label="Session"
          value={tab}
          onChange={setTab}
          tabs={[
            { id: 'controls', label: 'Controls' },
            { id: 'keys', label: 'Keys' },
            { id: 'state', label: 'State' },
            { id: 'log', label: 'Log' },
            { id: 'command', label: 'Command' },
          ]}
        >
          {tab === 'controls' && (
            <>
              <GroupedSliders id={id} sliders={sliders} />
              <ActionButtons id={id} verb={session.verb} actions={actions} />
              <p class="field-help">
                Keys work while the image has the focus. Click the image or press Tab to focus it. Press Tab
                again to leave it.
              </p>
            </>
          )}
          {tab === 'keys' && (
            <KeyTable verb={session.verb} actions={ownActions(actions)} reserved={blocked} />
          )}
          {tab === 'state' && <StateView id={id} />}
          {tab === 'log' && (
            <pre class="log" tabIndex={0} aria-label="Log">
              {session.log?.join('\n') || 'The log is empty.'}
            </pre>
          )}
          {tab === 'command' && (
            <>
              <p>To run the same in a window on the studio’s machine:</p>
              <CommandLine text={session.command} />
              <p class="faint">
                Shown to {session.viewers} {session.viewers === 1 ? 'viewer' : 'viewers'}, {session.frames}{' '}
                images so far.
              </p>
            </>
          )}
        </Tabs>
      </div>
      {change && (
        <ChangeFlags session={session} open={change} onClose={() => setChange(false)} end={endSession} />
      )}
    </div>
  );
}
