// Marks points on images: the program learns from them and proposes the rest.
import { useEffect, useRef, useState } from 'preact/hooks';
import { api } from '../../api';
import { useLoad, useSignalValue } from '../../hooks';
import { liveSession } from '../../live';
import {
  AsyncButton,
  Button,
  LiveStatus,
  LiveView,
  Notice,
  PageHead,
  Progress,
  Select,
  TextField,
} from '../../ui';
import { sendEvent } from '../../ui/live_view';
import { attempt } from '../../ui/toast';
import { cleanName, copyToSet, setName } from '../shared/files';
import { finishJob } from '../shared/jobs';
import { SessionActions, SetImages, SetSource, useSessionState } from '../shared/parts';
import { useAreaSession } from '../shared/sessions';
import { annotations, stateAddress } from './files';
import { moveCursor, pointName, stages, stateOf, tabsTo } from './model';

const blockedKeys: ReadonlySet<number> = new Set([27]); // Escape would end the session

export function Annotate() {
  const session = useAreaSession('landmarks annotate');
  const known = useLoad(annotations);
  const [set, setSet] = useState<{ name: string; files: number } | null>(null);
  const [name, setName_] = useState('');
  const [finished, setFinished] = useState<string | null>(null);
  const [file, setFile] = useState<string>('');
  const [drawing, setDrawing] = useState(false);

  const start = async (inputs: string[], output: string) => {
    setFinished(null);
    const started = await session.start(inputs, { '--output': `ws:${output}` }, output);
    if (started) setFile(output);
  };
  useEffect(() => {
    if (session.id === undefined || file !== '') return;
    api.sessionOf(session.id).then(
      (one) => setFile(one.name.endsWith('.points.json') ? one.name : ''),
      () => undefined,
    );
  }, [session.id]);
  const end = async () => {
    const last = await session.finish();
    if (last) {
      setFinished(file);
      setFile('');
    }
    known.again();
  };
  const synthetic = async () => {
    setDrawing(true);
    await attempt(async () => {
      const job = await finishJob({
        verb: 'pose synth',
        inputs: [],
        flags: {
          '--output': 'out:heads',
          '--count': 5,
          '--people': 5,
          '--yaw': 12,
          '--pitch': 6,
          '--roll': 5,
          '--near': 400,
          '--far': 480,
          '--size': '480x360',
        },
        name: 'Five synthetic faces',
      });
      const target = setName('drawn-faces');
      await api.addSet(target);
      const images = job.files.map((one) => one.name).filter((one) => one.startsWith('heads/images/'));
      await copyToSet(job.id, images, target);
      await start([`set:${target}`], `${target}.points.json`);
    });
    setDrawing(false);
  };

  return (
    <>
      <PageHead
        title="Annotate"
        text="Mark points on images. From the second image on, the program proposes them and improves with each image. Drag points that are wrong."
      />
      {session.id !== undefined ? (
        <Annotating id={session.id} file={file} onEnd={end} onGone={session.forget} />
      ) : (
        <div class="split">
          <section class="card stack" aria-labelledby="new-annotation">
            <h2 id="new-annotation">New annotation</h2>
            {finished && (
              <Notice kind="good">
                <p>
                  Saved as{' '}
                  <a href={stateAddress(finished)} download={finished}>
                    {finished}
                  </a>
                  .
                </p>
                <p>
                  <a href={`/train?data=${encodeURIComponent(`ws:${finished}`)}`}>Train with it</a>
                </p>
              </Notice>
            )}
            <SetSource
              kind="faces"
              label="Drop images here"
              help="Faces, hands, cars: any object with points that all images show. A video also works."
              accept="image/*,video/*"
              onSet={(one, files) => {
                setSet({ name: one, files });
                setName_(one);
              }}
            />
            {set && (
              <>
                <SetImages set={set.name} most={8} />
                <TextField
                  label="Name of the annotation"
                  value={name}
                  onInput={(text) => setName_(cleanName(text))}
                  help="If an annotation with this name exists, it is continued."
                />
              </>
            )}
            <div class="row">
              <AsyncButton
                kind="main"
                disabled={set === null || name === ''}
                run={async () => {
                  if (set) await start([`set:${set.name}`], `${name}.points.json`);
                }}
              >
                Annotate
              </AsyncButton>
              <Button busy={drawing} onClick={() => void synthetic()}>
                Try with synthetic data
              </Button>
            </div>
          </section>
          <section class="stack" aria-labelledby="annotations">
            <h2 id="annotations">Annotations</h2>
            {known.error && <Notice kind="problem">{known.error}</Notice>}
            {(known.value ?? []).length === 0 && <p class="faint">No annotations yet.</p>}
            <ul class="plain-list">
              {(known.value ?? []).map((one) => (
                <li key={one.name} class="stack">
                  <strong class="wrap">{one.name}</strong>
                  <div class="row">
                    <AsyncButton small run={() => start([], one.name)}>
                      Continue
                    </AsyncButton>
                    <a href={stateAddress(one.name)} download={one.name}>
                      Download
                    </a>
                    <a href={`/train?data=${encodeURIComponent(`ws:${one.name}`)}`}>Train with it</a>
                  </div>
                </li>
              ))}
            </ul>
            <p class="field-help">
              Every click is saved to a journal on the server's disk before it is shown. If the program stops,
              "Continue" restores all clicks.
            </p>
          </section>
        </div>
      )}
    </>
  );
}

function Annotating(props: { id: string; file: string; onEnd: () => Promise<void>; onGone: () => void }) {
  const live = liveSession(props.id);
  const ended = useSignalValue(live.ended);
  const state = stateOf(useSessionState(props.id));
  const [cursor, setCursor] = useState<{ x: number; y: number }>({ x: 512, y: 350 });
  const [cursorOn, setCursorOn] = useState(false);
  const box = useRef<HTMLDivElement>(null);
  const size = () => {
    const now = live.state.peek();
    return { width: now?.width || 1024, height: now?.height || 700 };
  };
  const click = () => {
    sendEvent(props.id, { mouse: 'left-down', ...cursor });
    sendEvent(props.id, { mouse: 'left-up', ...cursor });
  };
  const send = (action: string) => sendEvent(props.id, { action });
  const stage = stages.find((one) => one.name === state.stage);
  const chooseText = (index: number) => {
    const times = tabsTo(state.selected, index, state.points);
    for (let i = 0; i < times; i++) sendEvent(props.id, { key: 9 });
  };
  const { width, height } = size();
  return (
    <div class="split split-wide">
      <div class="stack">
        <ol class="steps" aria-label="Stages">
          {stages
            .filter((one) => one.name !== 'pick' || state.stage === 'pick')
            .map((one) => (
              <li key={one.name} aria-current={one.name === state.stage ? 'step' : undefined}>
                <button type="button" class="link" onClick={() => send(one.action)}>
                  {one.title}
                </button>
              </li>
            ))}
        </ol>
        <p>{stage?.text ?? ''}</p>
        <div class="annotate-image" ref={box}>
          <LiveView
            id={props.id}
            title="The image with its points"
            interactive
            drag
            whole
            moves={false}
            blockedKeys={blockedKeys}
          />
          {cursorOn && (
            <svg class="cursor" viewBox={`0 0 ${width} ${height}`} aria-hidden="true">
              <path d={`M${cursor.x - 30} ${cursor.y}h24m12 0h24M${cursor.x} ${cursor.y - 30}v24m0 12v24`} />
            </svg>
          )}
        </div>
        <LiveStatus id={props.id} />
        {state.images > 0 && <Progress label="Confirmed images" done={state.done} total={state.images} />}
        <div class="row">
          <Button kind="main" onClick={() => send('go-on')}>
            Confirm and continue
          </Button>
          <Button onClick={() => send('undo')}>Undo</Button>
          <Button onClick={() => send('redo')}>Redo</Button>
          <AsyncButton run={ended ? async () => props.onGone() : props.onEnd}>
            {ended ? 'Close' : 'Save and end'}
          </AsyncButton>
        </div>
        {ended && (
          <Notice kind={ended.error ? 'problem' : 'info'}>
            {ended.error ?? 'The session has ended.'} No work is lost: "Continue" resumes it.
          </Notice>
        )}
      </div>
      <div class="stack">
        <section class="card stack" aria-labelledby="by-keys">
          <h2 id="by-keys">Place points with the keyboard</h2>
          <p class="field-help" id="by-keys-help">
            Focus the field below. The arrow keys move the cross, with Shift ten times as far. Enter or Space
            clicks at the cross.
          </p>
          <div
            class="pad"
            role="application"
            aria-label={`Cross at ${Math.round(cursor.x)}, ${Math.round(cursor.y)} of ${width} by ${height}`}
            aria-describedby="by-keys-help"
            tabIndex={0}
            onFocus={() => setCursorOn(true)}
            onBlur={() => setCursorOn(false)}
            onKeyDown={(event) => {
              const next = moveCursor(cursor, event.key, event.shiftKey, size());
              if (next) setCursor(next);
              else if (event.key === 'Enter' || event.key === ' ') click();
              else return;
              event.preventDefault();
            }}
          >
            Cross at {Math.round(cursor.x)}, {Math.round(cursor.y)}
          </div>
        </section>
        <section class="card stack" aria-labelledby="points">
          <h2 id="points">
            Points: {state.shown} of {state.points} visible
          </h2>
          {state.points > 0 && (
            <>
              <Select
                label="Selected point"
                value={String(state.selected)}
                options={[
                  { value: '-1', label: 'none' },
                  ...Array.from({ length: state.points }, (_, i) => ({
                    value: String(i),
                    label: `${i + 1}: ${pointName(i, state.points)}${placeText(state.places?.[i])}`,
                  })),
                ]}
                onChange={(value) => {
                  if (Number(value) >= 0) chooseText(Number(value));
                }}
                help="The arrow keys move it on the image, with Shift further."
              />
              <div class="row">
                <Button small onClick={() => sendEvent(props.id, { key: 9 })}>
                  Next point
                </Button>
                {(
                  [
                    ['←', 0x10001, 'left'],
                    ['→', 0x10002, 'right'],
                    ['↑', 0x10003, 'up'],
                    ['↓', 0x10004, 'down'],
                  ] as const
                ).map(([label, key, word]) => (
                  <Button
                    key={word}
                    small
                    aria-label={`Move the point ${word}`}
                    disabled={state.selected < 0}
                    onClick={() => sendEvent(props.id, { key })}
                  >
                    {label}
                  </Button>
                ))}
                <Button small disabled={state.selected < 0} onClick={() => send('hide')}>
                  Hide or show
                </Button>
                <Button small disabled={state.selected < 0} onClick={() => send('delete')}>
                  Delete
                </Button>
              </div>
            </>
          )}
          <p class="faint">
            Image {state.image + 1} of {state.images}
            {state.agreed ? ', confirmed' : ', not confirmed'}
            {state.learning ? ', training' : ''}
          </p>
          <div class="row">
            <Button small onClick={() => send('previous')}>
              Previous image
            </Button>
            <Button small onClick={() => send('next')}>
              Next image
            </Button>
            <Button small onClick={() => send('propose')}>
              Propose again
            </Button>
          </div>
        </section>
        <details>
          <summary>View and other actions</summary>
          <SessionActions
            id={props.id}
            label="View and other actions"
            without={[
              'go-on',
              'undo',
              'redo',
              'previous',
              'next',
              'propose',
              'hide',
              'delete',
              'quit',
              'help',
              ...stages.map((one) => one.action),
            ]}
          />
        </details>
        <p class="field-help">
          {props.file !== '' ? `Saved in ${props.file}. ` : ''}Every click is saved before it is shown.
        </p>
      </div>
    </div>
  );
}

function placeText(place: [number, number] | null | undefined): string {
  if (place === undefined) return '';
  return place === null ? ', hidden' : `, at ${place[0].toFixed(0)}, ${place[1].toFixed(0)}`;
}
