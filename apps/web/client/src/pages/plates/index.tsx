// Number plates: read a source into the log, look for what passed.
import { useEffect, useRef, useState } from 'preact/hooks';
import { api } from '../../api';
import { durationText, timeText } from '../../format';
import { useEvery, useLoad } from '../../hooks';
import {
  AsyncButton,
  Button,
  Checkbox,
  Dialog,
  Notice,
  PageHead,
  Progress,
  Select,
  Table,
  TextField,
} from '../../ui';
import { attempt, toast } from '../../ui/toast';
import { hasState, save } from '../shared/files';
import { finishJob, jobBlob } from '../shared/jobs';
import {
  filled,
  SessionActions,
  SessionPanel,
  SourceSelect,
  StateList,
  useSessionState,
} from '../shared/parts';
import { useAreaSession } from '../shared/sessions';
import {
  areHours,
  cleanPattern,
  cleanText,
  eventOf,
  flagsOf,
  histogram,
  sinceChoices,
  confidenceLevel,
  textOf,
  watchEntryOf,
  whenText,
  type PlateEvent,
  type Query,
  type WatchEntry,
} from './model';

const log = 'ws:plates.db';
const watchList = 'ws:watch.csv';
const street = { id: 'synth:drive?live=1&seconds=60&cars=6&fps=8', name: 'Synthetic street' };
const dayHours = [1, 4, 7, 9, 14, 20]; // hours before now of a drawn day
const perPage = 500;

interface Images {
  job: string;
  files: ReadonlyMap<number, string>; // event -> file of the job
}

async function search(query: Query): Promise<PlateEvent[]> {
  // Before anything was read there is no log.
  if (!(await hasState('plates.db'))) return [];
  const answer = await api.run('plate log', [log], flagsOf(query));
  const events = answer.lines.map(eventOf).filter((one): one is PlateEvent => one !== null);
  return events.sort((a, b) => b.last_time.localeCompare(a.last_time));
}

async function watched(): Promise<WatchEntry[]> {
  if (!(await hasState('watch.csv'))) return [];
  const answer = await api.run('plate watch list', [watchList]);
  return answer.lines.map(watchEntryOf).filter((one): one is WatchEntry => one !== null);
}

async function imagesOf(before: Images | null, query: Query): Promise<Images> {
  const job = await finishJob({
    verb: 'plate log',
    inputs: [log],
    flags: { ...flagsOf(query), '--crops': 'out:crops' },
    name: 'Images of plates',
  });
  if (before) await api.removeJob(before.job).catch(() => undefined);
  const files = new Map<number, string>();
  for (const file of job.files) {
    const found = /^crops\/(\d+)-[^/]*$/.exec(file.name);
    if (found) files.set(Number(found[1]), file.name);
  }
  return { job: job.id, files };
}

export function Plates() {
  const [source, setSource] = useState(street.id);
  const [country, setCountry] = useState('');
  const session = useAreaSession('plate read');
  const state = useSessionState(session.id);
  const [typed, setTyped] = useState<Query>({ text: '', near: false, since: '', limit: perPage });
  const [query, setQuery] = useState<Query>(typed);
  const found = useLoad(async () => ({ query, list: await search(query) }), [query]);
  // What was found for another question is not shown.
  const events = { ...found, value: found.value?.query === query ? found.value.list : undefined };
  const [images, setImages] = useState<Images | null>(null);
  const fetching = useRef(false);
  const [round, setRound] = useState(0);
  const [open, setOpen] = useState<PlateEvent | null>(null);
  const [day, setDay] = useState<{ done: number; total: number } | null>(null);
  const watch = useLoad(watched);

  // While something is read, new events come in.
  useEvery(
    3,
    () => {
      if (session.id !== undefined) events.again();
    },
    [session.id, query],
  );

  // Images are cut out of the log by a job: one at a time, and again only for events without one.
  useEffect(() => {
    const wanted = (events.value ?? []).some((one) => one.crop && !images?.files.has(one.id));
    if (!wanted || fetching.current) return;
    fetching.current = true;
    imagesOf(images, query)
      .then(setImages, () => undefined)
      .finally(() => {
        // Not oftener than each ten seconds.
        setTimeout(() => {
          fetching.current = false;
          setRound((one) => one + 1);
        }, 10_000);
      });
  }, [events.value, round]);

  const drawnDay = async () => {
    const now = Date.now();
    for (let i = 0; i < dayHours.length; i++) {
      setDay({ done: i, total: dayHours.length });
      const start = new Date(now - dayHours[i]! * 3600_000).toISOString().slice(0, 19);
      const done = await attempt(() =>
        finishJob({
          verb: 'plate read',
          inputs: [`synth:drive?seconds=4&cars=${2 + (i % 2)}&fps=4&seed=${i + 1}`],
          flags: { '--log': log, '--events': true, '--start': start },
          name: 'A synthetic street',
        }),
      );
      if (!done) break;
      void api.removeJob(done.id).catch(() => undefined);
      events.again();
    }
    setDay(null);
    events.again();
  };

  const list = events.value ?? [];
  const isNarrow = query.text !== '' || query.since !== '';
  return (
    <>
      <PageHead
        title="Plates"
        text="Reads number plates from a camera or video, logs each vehicle, and searches the log."
      />
      <div class="split">
        <section class="card stack" aria-labelledby="read">
          <h2 id="read">Read</h2>
          {session.id === undefined ? (
            <>
              <SourceSelect label="Source" value={source} own={street} onChange={setSource} />
              <TextField
                label="Countries"
                value={country}
                onInput={setCountry}
                help="Leave it empty for all known countries, or enter codes such as es or pt, or eu for the whole group."
              />
              <div class="row">
                <AsyncButton
                  kind="main"
                  run={async () => {
                    await session.start(
                      [source],
                      filled({
                        '--log': log,
                        '--events': true,
                        '--country': country.trim(),
                        '--watch': (watch.value?.length ?? 0) > 0 ? watchList : '',
                      }),
                      'Plates',
                    );
                  }}
                >
                  Start reading
                </AsyncButton>
              </div>
              <p class="field-help">
                Vehicles are added to the log of this workspace as they pass. Number plates are personal data
                in many countries: store no more than you need.
              </p>
            </>
          ) : (
            <>
              <SessionPanel
                id={session.id}
                title="Reading plates"
                end="Stop reading"
                onEnd={async () => {
                  await session.end();
                  events.again();
                }}
              />
              <StateList state={state} names={{ plates: 'Visible plates', events: 'Vehicles in the log' }} />
              <SessionActions id={session.id} label="Actions" without={['quit', 'help']} />
            </>
          )}
          <hr />
          <Watch entries={watch.value ?? []} problem={watch.error} onChanged={() => watch.again()} />
          <hr />
          <h3>No camera?</h3>
          {day ? (
            <Progress label="Generating a day of traffic" done={day.done} total={day.total} unit="hours" />
          ) : (
            <Button onClick={() => void drawnDay()}>Try with synthetic data</Button>
          )}
          <p class="field-help">
            Generates cars at several hours of the last day, reads their plates, and adds them to the log.
          </p>
        </section>
        <section class="stack" aria-labelledby="events">
          <h2 id="events">Events</h2>
          <form
            class="search"
            role="search"
            onSubmit={(event) => {
              event.preventDefault();
              setQuery({ ...typed });
            }}
          >
            <TextField
              label="Plate text"
              type="search"
              value={typed.text}
              onInput={(text) => setTyped({ ...typed, text })}
              help="A part is enough. * matches any characters, ? matches one."
            />
            <Select
              label="When"
              value={typed.since}
              options={[...sinceChoices]}
              onChange={(since) => setTyped({ ...typed, since })}
            />
            <Checkbox
              label="Similar texts"
              checked={typed.near}
              onChange={(near) => setTyped({ ...typed, near })}
              help="One character may differ; O equals 0, and I equals 1."
            />
            <div class="row">
              <Button kind="main" type="submit">
                Search
              </Button>
              {isNarrow && (
                <Button
                  onClick={() => {
                    const all = { text: '', near: false, since: '', limit: perPage };
                    setTyped(all);
                    setQuery(all);
                  }}
                >
                  Show all
                </Button>
              )}
              <AsyncButton
                disabled={list.length === 0}
                run={async () => {
                  await attempt(async () => {
                    const job = await finishJob({
                      verb: 'plate log',
                      inputs: [log],
                      flags: { ...flagsOf(query), '--csv': 'out:plates.csv' },
                      name: 'Table of plates',
                    });
                    save('plates.csv', await jobBlob(job.id, 'plates.csv'));
                  });
                }}
              >
                Download as CSV
              </AsyncButton>
              <AsyncButton
                disabled={!list.some((one) => one.correction !== null)}
                run={async () => {
                  await attempt(async () => {
                    const job = await finishJob({
                      verb: 'plate log',
                      inputs: [log],
                      flags: { ...flagsOf(query), '--corrections': 'out:corrected' },
                      name: 'Corrected plates',
                    });
                    const count = job.files.filter((one) => one.name.endsWith('.jpg')).length;
                    toast(
                      `The job "Corrected plates" has ${count} corrected plates. Train a reader with them.`,
                      'good',
                    );
                  });
                }}
              >
                Save as training data
              </AsyncButton>
            </div>
          </form>
          {events.error && <Notice kind="problem">{events.error}</Notice>}
          <p class="numbers" role="status">
            {events.value === undefined
              ? 'Searching the log.'
              : `${list.length} ${list.length === 1 ? 'event' : 'events'}${isNarrow ? ' found' : ''}${list.length >= perPage ? ', newest only; narrow the search to see others' : ''}`}
          </p>
          {list.length > 0 && <When events={list} />}
          {list.length > 0 && (
            <Table
              caption="Vehicles, newest first"
              hideCaption
              columns={[
                {
                  name: 'Plate',
                  show: (one) => <Plate event={one} images={images} />,
                },
                { name: 'Time', show: (one) => <Seen event={one} /> },
                {
                  name: 'More',
                  show: (one) => (
                    <Button small aria-label={`More about ${textOf(one)}`} onClick={() => setOpen(one)}>
                      More
                    </Button>
                  ),
                },
              ]}
              rows={list}
              keyOf={(one) => one.id}
            />
          )}
          {list.length === 0 && events.value !== undefined && !isNarrow && (
            <p class="faint">No events yet. Start reading, or try with synthetic data.</p>
          )}
        </section>
      </div>
      <Dialog
        title={open ? `Plate ${textOf(open)}` : 'Plate'}
        open={open !== null}
        onClose={() => setOpen(null)}
        wide
      >
        {open && (
          <EventDetail
            event={open}
            images={images}
            onCorrected={() => {
              events.again();
              setOpen(null);
            }}
          />
        )}
      </Dialog>
    </>
  );
}

// The plates that matter: reading says which of them it sees.
function Watch(props: { entries: WatchEntry[]; problem: string | undefined; onChanged: () => void }) {
  const [plate, setPlate] = useState('');
  const [label, setLabel] = useState('');
  const [hours, setHours] = useState('');
  const clean = cleanPattern(plate);
  const add = async () => {
    if (clean === null) return;
    await attempt(async () => {
      await api.run(
        'plate watch add',
        [watchList, clean],
        filled({ '--label': label.trim(), '--hours': hours.trim() || 'any' }),
      );
      setPlate('');
      setLabel('');
      setHours('');
      props.onChanged();
    });
  };
  return (
    <section class="stack" aria-labelledby="watch">
      <h3 id="watch">Watch list</h3>
      {props.problem && <Notice kind="problem">{props.problem}</Notice>}
      {props.entries.length > 0 && (
        <Table
          caption="Watch list"
          hideCaption
          stacks
          columns={[
            {
              name: 'Plate',
              show: (one) => (
                <span class="plate-words">
                  <strong>{one.plate}</strong>
                  <span class="faint">{one.label}</span>
                </span>
              ),
            },
            { name: 'When', show: (one) => whenText(one) },
            {
              name: 'Remove',
              show: (one) => (
                <AsyncButton
                  small
                  aria-label={`Remove ${one.plate}`}
                  run={async () => {
                    await attempt(() => api.run('plate watch remove', [watchList, one.plate]));
                    props.onChanged();
                  }}
                >
                  Remove
                </AsyncButton>
              ),
            },
          ]}
          rows={props.entries}
          keyOf={(one) => `${one.plate} ${one.hours ?? ''} ${one.days ?? ''}`}
        />
      )}
      <form
        class="stack"
        aria-label="Add a plate to the watch list"
        onSubmit={(event) => {
          event.preventDefault();
        }}
      >
        <TextField
          label="Plate"
          value={plate}
          onInput={setPlate}
          problem={plate !== '' && clean === null ? 'Use letters, digits, * and ? only.' : ''}
          help="* matches any characters, ? matches one. Characters that the reader often confuses are tolerated."
        />
        <TextField label="Label" value={label} onInput={setLabel} />
        <TextField
          label="Hours"
          value={hours}
          onInput={setHours}
          problem={areHours(hours) ? '' : 'Enter a time range, such as 08:00-18:00.'}
          help="Leave it empty for all day, or enter a range such as 22:00-06:00."
        />
        <div class="row">
          <AsyncButton disabled={clean === null || !areHours(hours)} run={add}>
            Add to the watch list
          </AsyncButton>
        </div>
      </form>
    </section>
  );
}

function Plate(props: { event: PlateEvent; images: Images | null }) {
  const file = props.images?.files.get(props.event.id);
  return (
    <span class="plate">
      <span class="plate-place">
        {file && props.images && (
          <img src={api.jobFileAddress(props.images.job, file)} alt="" loading="lazy" />
        )}
      </span>
      <span class="plate-words">
        <strong class="plate-text">{textOf(props.event)}</strong>
        {props.event.correction !== null && <span class="faint">read as {props.event.text}</span>}
        <span class="faint">
          {(100 * props.event.confidence).toFixed(0)} %, {confidenceLevel(props.event.confidence)} confidence
          {props.event.country === '' ? '' : `, ${props.event.country}`}
        </span>
      </span>
    </span>
  );
}

function Seen({ event }: { event: PlateEvent }) {
  const [day, time] = timeText(event.first_time).split(' ');
  const stay = (Date.parse(event.last_time) - Date.parse(event.first_time)) / 1000;
  return (
    <span class="plate-words">
      <span class="nowrap">{day}</span>
      <span class="nowrap">{time}</span>
      <span class="faint">
        {stay >= 1 ? `for ${durationText(stay)}` : 'for a moment'}
        {event.state === 'closed' ? '' : `, ${event.state}`}
      </span>
    </span>
  );
}

// Whether the page is as wide as a phone's; follows it when it is turned.
function useIsNarrow(): boolean {
  const [isNarrow, setIsNarrow] = useState(() => window.innerWidth < 600);
  useEffect(() => {
    const update = () => setIsNarrow(window.innerWidth < 600);
    addEventListener('resize', update);
    return () => removeEventListener('resize', update);
  }, []);
  return isNarrow;
}

// Events by hour or day, as bars and as a table.
function When({ events }: { events: PlateEvent[] }) {
  const zone = -new Date().getTimezoneOffset();
  const { bars, step } = histogram(
    events.map((one) => one.first_time),
    zone,
  );
  const most = Math.max(1, ...bars.map((bar) => bar.count));
  const isDay = step > 3600_000;
  const label = (start: number) => {
    const text = timeText(start);
    return isDay ? text.slice(0, 10) : text.slice(11, 16);
  };
  // A phone shows it 1:1, so that its labels can be read.
  const width = useIsNarrow() ? 320 : 600;
  const height = 90;
  const bar = width / bars.length;
  const every = Math.ceil(bars.length / (width / 75));
  return (
    <figure class="when">
      <figcaption>Vehicles by {isDay ? 'day' : 'hour'}</figcaption>
      <svg
        viewBox={`0 0 ${width} ${height + 16}`}
        role="img"
        aria-label={`Vehicles by ${isDay ? 'day' : 'hour'}; the table below has the numbers`}
      >
        <line class="axis" x1={0} y1={height} x2={width} y2={height} />
        {bars.map((one, i) => (
          <g key={one.start}>
            <rect
              class="bar"
              x={i * bar + 0.1 * bar}
              y={height - (height * one.count) / most}
              width={Math.min(0.8 * bar, 40)}
              height={(height * one.count) / most}
            >
              <title>{`${label(one.start)}: ${one.count}`}</title>
            </rect>
            {i % every === 0 && (
              <text class="tick" x={i * bar + 0.1 * bar} y={height + 13}>
                {label(one.start)}
              </text>
            )}
          </g>
        ))}
      </svg>
      <details>
        <summary>Show as table</summary>
        <Table
          caption={`Vehicles by ${isDay ? 'day' : 'hour'}`}
          hideCaption
          columns={[
            { name: isDay ? 'Day' : 'Hour', show: (one) => timeText(one.start).slice(0, isDay ? 10 : 16) },
            { name: 'Vehicles', show: (one) => one.count, number: true },
          ]}
          rows={bars.filter((one) => one.count > 0)}
          keyOf={(one) => one.start}
        />
      </details>
    </figure>
  );
}

interface Character {
  text: string;
  confidence: number;
}

function EventDetail(props: { event: PlateEvent; images: Images | null; onCorrected: () => void }) {
  const { event, images } = props;
  const file = images?.files.get(event.id);
  const [text, setText] = useState(textOf(event));
  const clean = cleanText(text);
  // What is sure of each character: the program reads the kept image once more.
  const read = useLoad(async () => {
    if (!file || !images) return null;
    const answer = await api.run('plate read', [`job:${images.job}/${file}`]);
    const line = answer.lines[0] as { plates?: { text: string; characters?: Character[] }[] } | undefined;
    return line?.plates?.[0] ?? null;
  }, [event.id, file]);
  const correct = async () => {
    if (clean === null) return;
    await attempt(async () => {
      await api.run('plate log', [log], { '--correct': [String(event.id), clean] });
      toast(`Corrected to ${clean}; the original reading is kept.`, 'good');
      props.onCorrected();
    });
  };
  const undo = async () => {
    await attempt(async () => {
      await api.run('plate log', [log], { '--undo-correction': event.id });
      props.onCorrected();
    });
  };
  return (
    <div class="stack">
      {file && images && (
        <img
          class="plate-large"
          src={api.jobFileAddress(images.job, file)}
          alt={`Image of the plate ${event.text}`}
        />
      )}
      {read.value?.characters && read.value.characters.length > 0 && (
        <>
          <h3>Confidence of each character in this image</h3>
          <ul class="characters">
            {read.value.characters.map((one, i) => (
              <li key={i} class={`character character-${confidenceLevel(one.confidence)}`}>
                <span class="character-text">{one.text}</span>
                <span class="character-confidence">{(100 * one.confidence).toFixed(0)} %</span>
              </li>
            ))}
          </ul>
        </>
      )}
      {file && read.value === null && !read.loading && (
        <p class="faint">No plate is detected in this single image; the text was voted over all frames.</p>
      )}
      <Table
        caption="Alternative readings"
        columns={[
          { name: 'Text', show: (one) => one.text },
          { name: 'Confidence', show: (one) => `${(100 * one.confidence).toFixed(1)} %`, number: true },
          { name: 'Country', show: (one) => one.country ?? '' },
        ]}
        rows={event.candidates.filter((one) => one.text !== event.text).slice(0, 5)}
        keyOf={(one) => one.text}
      />
      <details>
        <summary>{event.readings.length} readings, one per frame</summary>
        <Table
          caption="Readings"
          hideCaption
          columns={[
            { name: 'Time, s', show: (one) => one.time.toFixed(1), number: true },
            { name: 'Text', show: (one) => one.text },
            { name: 'Confidence', show: (one) => `${(100 * one.confidence).toFixed(0)} %`, number: true },
          ]}
          rows={event.readings.slice(0, 300)}
          keyOf={(_, i) => i}
        />
      </details>
      <p class="faint">
        {event.frames} frames, from {timeText(event.first_time)} to {timeText(event.last_time)}, source{' '}
        {event.source}
      </p>
      <form
        class="stack"
        onSubmit={(one) => {
          one.preventDefault();
        }}
      >
        <TextField
          label="Correct text"
          value={text}
          onInput={setText}
          problem={clean === null ? 'Use letters and digits, 20 at most.' : ''}
          help="It is stored in the log with the original reading. Searches find both, and a reader can be trained with it."
        />
        <div class="row row-end">
          {event.correction !== null && (
            <AsyncButton run={undo}>Undo the correction of {event.correction.author}</AsyncButton>
          )}
          <AsyncButton kind="main" disabled={clean === null || clean === textOf(event)} run={correct}>
            Correct
          </AsyncButton>
        </div>
      </form>
    </div>
  );
}
