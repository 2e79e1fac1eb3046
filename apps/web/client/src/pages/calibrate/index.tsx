// What a camera does to light: print a board, show it to the camera, keep the camera file.
import type { ComponentChildren } from 'preact';
import { useEffect, useState } from 'preact/hooks';
import { api, call, type Json } from '../../api';
import { useLoad } from '../../hooks';
import {
  AsyncButton,
  Button,
  JobCard,
  Notice,
  PageHead,
  Progress,
  Select,
  Table,
  Tabs,
  TextField,
} from '../../ui';
import { attempt } from '../../ui/toast';
import { cleanName } from '../shared/files';
import { isOver, jobText, lineWith, useJob } from '../shared/jobs';
import {
  SessionActions,
  SessionPanel,
  SetImages,
  SetSource,
  SourceSelect,
  StateList,
  useSessionState,
} from '../shared/parts';
import { useAreaSession } from '../shared/sessions';
import { parseCsv } from '../train/curves';
import { boards, cameraRows, perViewOf, squareProblem, viewOf, type CameraLine, type View } from './model';

const synthetic = { id: 'synth:board?live=1', name: 'Synthetic board' };
const tabs = [
  { id: 'print', label: '1. Print a board' },
  { id: 'live', label: '2. Show it to the camera' },
  { id: 'photos', label: 'Or use images' },
];

export function Calibrate() {
  const [tab, setTab] = useState('print');
  const [board, setBoard] = useState('chess:9x6');
  const [square, setSquare] = useState('25');
  const session = useAreaSession('calibrate');
  useEffect(() => {
    if (session.id !== undefined) setTab('live');
  }, [session.id]);
  const problem = squareProblem(square);
  const shared = (
    <div class="fields">
      <Select label="Board" value={board} options={[...boards]} onChange={setBoard} />
      <TextField
        label="Square size, mm"
        type="number"
        min={1}
        max={1000}
        step="any"
        value={square}
        onInput={setSquare}
        problem={problem}
        help="For a circle grid: the distance of neighbouring circles. It sets the scale of distances and does not change the lens parameters."
      />
    </div>
  );
  return (
    <>
      <PageHead
        title="Calibrate"
        text="Computes focal length, principal point and distortion of a camera from views of a printed board. Reconstruction, head pose and markers use the result."
      />
      <Tabs label="Calibrate" tabs={tabs} value={tab} onChange={setTab}>
        {tab === 'print' && (
          <Print board={board} square={square} good={problem === ''} onNext={() => setTab('live')}>
            {shared}
          </Print>
        )}
        {tab === 'live' && (
          <Live board={board} square={square} good={problem === ''} session={session}>
            {shared}
          </Live>
        )}
        {tab === 'photos' && (
          <Photos board={board} square={square} good={problem === ''}>
            {shared}
          </Photos>
        )}
      </Tabs>
    </>
  );
}

interface PartProps {
  board: string;
  square: string;
  good: boolean;
  children: ComponentChildren;
}

function Print(props: PartProps & { onNext: () => void }) {
  const [page, setPage] = useState('a4');
  const [format, setFormat] = useState('pdf');
  const [started, setStarted] = useState<string>();
  const job = useJob(started);
  const file = job?.files.find((one) => one.name === `board.${format}`) ?? job?.files[0];
  return (
    <section class="card stack" aria-labelledby="print">
      <h2 id="print">Print a board</h2>
      {props.children}
      <div class="fields">
        <Select
          label="Paper"
          value={page}
          options={[
            { value: 'a4', label: 'A4' },
            { value: 'a3', label: 'A3' },
            { value: 'letter', label: 'Letter' },
          ]}
          onChange={setPage}
        />
        <Select
          label="File"
          value={format}
          options={[
            { value: 'pdf', label: 'PDF, to print' },
            { value: 'svg', label: 'SVG' },
            { value: 'png', label: 'PNG' },
          ]}
          onChange={setFormat}
        />
      </div>
      <div class="row">
        <AsyncButton
          kind="main"
          disabled={!props.good}
          run={async () => {
            const one = await attempt(() =>
              api.startJob({
                verb: 'ar marker-sheet',
                inputs: [],
                flags: {
                  '--board': props.board,
                  '--square': `${props.square}mm`,
                  '--page': page,
                  '--output': `out:board.${format}`,
                },
                name: `Board ${props.board}, ${props.square} mm`,
              }),
            );
            if (one) setStarted(one.id);
          }}
        >
          Create the sheet
        </AsyncButton>
        <Button onClick={props.onNext}>I have a board: continue</Button>
      </div>
      {job && job.state !== 'done' && <JobCard job={job} />}
      {job?.state === 'done' && file && (
        <Notice kind="good">
          <p>
            <a href={api.jobFileAddress(job.id, file.name)} download={file.name}>
              Download {file.name}
            </a>
          </p>
          <p>
            Print it at 100 %, without fitting to the page. The 10 cm line on the sheet must measure 10 cm.
            Glue the sheet to a flat surface.
          </p>
        </Notice>
      )}
      <p class="field-help">The synthetic camera needs no print: it shows the 9 x 6 board.</p>
    </section>
  );
}

function Live(props: PartProps & { session: ReturnType<typeof useAreaSession> }) {
  const { session } = props;
  const [source, setSource] = useState(synthetic.id);
  const [name, setName] = useState('camera');
  const [written, setWritten] = useState<string | null>(null);
  const [file, setFile] = useState('');
  const state = useSessionState(session.id);
  const views = typeof state.views === 'number' ? state.views : 0;
  const coverage = typeof state.coverage === 'number' ? state.coverage : 0;
  const missing = Array.isArray(state.missing) ? state.missing.map(String) : [];
  const perView = perViewOf(state.per_view);
  const cameraFile = useLoad(
    async () => (written === null ? null : (await call(`/api/state/${encodeURIComponent(written)}`)).text()),
    [written],
  );
  const start = async (input: string) => {
    const output = `${cleanName(name)}.yaml`;
    setWritten(null);
    setFile(output);
    await session.start(
      [input],
      { '--board': props.board, '--square': `${props.square}mm`, '--output': `ws:${output}` },
      output,
    );
  };
  const finish = async () => {
    const last = await session.finish();
    if (last) setWritten(file || last.name);
  };
  if (session.id !== undefined) {
    return (
      <div class="split split-wide">
        <SessionPanel
          id={session.id}
          title="The board in front of the camera"
          end="Finish and save the camera"
          onEnd={finish}
        />
        <div class="stack">
          <Progress label="Coverage" done={Math.round(100 * coverage)} total={100} />
          <StateList
            state={state}
            names={{
              views: 'Accepted views',
              verdict: 'Status',
              rms: 'Error, px',
              fx: 'Focal length, px',
              refusal: 'Why not accepted',
            }}
          />
          {missing.length > 0 && (
            <section aria-labelledby="missing">
              <h3 id="missing">Still needed</h3>
              <ul aria-live="polite">
                {missing.slice(0, 5).map((one) => (
                  <li key={one}>{one}</li>
                ))}
              </ul>
            </section>
          )}
          <SessionActions id={session.id} label="Actions" without={['quit', 'help']} />
          {perView.length > 0 && (
            <Table
              caption="Views"
              columns={[
                { name: 'View', show: (one) => one.n, number: true },
                { name: 'Error, px', show: (one) => one.rms.toFixed(3), number: true },
                { name: 'Tilt, degrees', show: (one) => one.tilt.toFixed(0), number: true },
                { name: 'Points', show: (one) => one.points, number: true },
              ]}
              rows={perView.map((one, i) => ({ ...one, n: i + 1 }))}
              keyOf={(one) => one.n}
            />
          )}
          {views < 10 && (
            <p class="field-help">
              Take 10 to 20 views, tilted in all directions, in all parts of the image.
            </p>
          )}
        </div>
      </div>
    );
  }
  return (
    <section class="card stack" aria-labelledby="live-calibration">
      <h2 id="live-calibration">Show it to the camera</h2>
      {written !== null && (
        <Notice kind="good">
          <p>
            The camera is saved as{' '}
            <a href={`/api/state/${encodeURIComponent(written)}`} download={written}>
              {written}
            </a>
            .
          </p>
          {cameraFile.value && (
            <pre class="log" tabIndex={0} role="group" aria-label="The camera file">
              {cameraFile.value}
            </pre>
          )}
        </Notice>
      )}
      {props.children}
      <SourceSelect label="Camera" value={source} own={synthetic} onChange={setSource} />
      <TextField label="Name of the camera file" value={name} onInput={setName} />
      <p>
        Move the board slowly. A view is accepted automatically when the board is still, sharp and in a new
        pose. Tilt the board by 20 to 45 degrees, and show it in the corners of the image too.
      </p>
      <div class="row">
        <AsyncButton kind="main" disabled={!props.good} run={() => start(source)}>
          Start
        </AsyncButton>
        <AsyncButton run={() => start(synthetic.id)}>Try with synthetic data</AsyncButton>
      </div>
    </section>
  );
}

function Photos(props: PartProps) {
  const [set, setSet] = useState<{ name: string; files: number } | null>(null);
  const [lens, setLens] = useState('pinhole');
  const [started, setStarted] = useState<string>();
  const job = useJob(started);
  const start = async (input: string, name: string) => {
    const one = await attempt(() =>
      api.startJob({
        verb: 'calibrate',
        inputs: [input],
        flags: {
          '--board': props.board,
          '--square': `${props.square}mm`,
          '--output': 'out:camera.yaml',
          '--csv': 'out:views.csv',
          '--draw': 'out:drawn',
          ...(lens === 'pinhole' ? {} : { '--lens': lens }),
        },
        name,
      }),
    );
    if (one) setStarted(one.id);
  };
  return (
    <div class="stack">
      <section class="card stack" aria-labelledby="photos">
        <h2 id="photos">From images of the board</h2>
        {props.children}
        <SetSource
          kind="board"
          label="Drop images of the board"
          help="10 to 20 images from the same camera, with the same focus and zoom. A video also works."
          accept="image/*,video/*"
          onSet={(name, files) => setSet({ name, files })}
        />
        {set && <SetImages set={set.name} most={12} />}
        <Select
          label="Lens"
          value={lens}
          options={[
            { value: 'pinhole', label: 'Standard (pinhole)' },
            { value: 'rational', label: 'Wide (rational)' },
            { value: 'fisheye', label: 'Fisheye, more than 100 degrees' },
          ]}
          onChange={setLens}
        />
        <div class="row">
          <AsyncButton
            kind="main"
            disabled={!props.good || set === null}
            run={async () => {
              if (set) await start(`set:${set.name}`, `Calibration, ${set.name}`);
            }}
          >
            Calibrate
          </AsyncButton>
          <AsyncButton
            disabled={!props.good}
            run={() => start('synth:board?frames=250', 'Calibration of a synthetic camera')}
          >
            Try with synthetic data
          </AsyncButton>
        </div>
      </section>
      {job && <JobCard job={job} files={false} onChange={() => setStarted(undefined)} />}
      {job && isOver(job) && job.state === 'done' && (
        <Result id={job.id} lines={job.lines} files={job.files.map((one) => one.name)} />
      )}
    </div>
  );
}

function Result(props: { id: string; lines: Json[]; files: string[] }) {
  const line = lineWith<CameraLine>(props.lines, 'camera');
  const views = useLoad(async () => parseCsv(await jobText(props.id, 'views.csv')).map(viewOf), [props.id]);
  const used = (views.value ?? []).filter((one) => one.used).sort((a, b) => b.rms - a.rms);
  const left = (views.value ?? []).filter((one) => !one.used);
  const worst = Math.max(1e-9, ...used.map((one) => one.rms));
  const drawn = props.files.filter((one) => one.startsWith('drawn/') && !one.endsWith('coverage.png'));
  return (
    <section class="stack" aria-labelledby="camera">
      <h2 id="camera">Calibrated camera</h2>
      {line && (
        <>
          <p class="numbers">
            Reprojection error {line.rms.toFixed(3)} px, {line.used} of {line.images} images used,{' '}
            {Math.round(100 * line.coverage)} % of the image covered
          </p>
          {[...(line.warnings ?? []), ...(line.missing ?? []).map((one) => `Still needed: ${one}`)].length >
            0 && (
            <Notice>
              <ul>
                {(line.warnings ?? []).map((one) => (
                  <li key={one}>{one}</li>
                ))}
                {(line.missing ?? []).map((one) => (
                  <li key={one}>Still needed: {one}</li>
                ))}
              </ul>
            </Notice>
          )}
          <Table
            caption="Camera parameters"
            columns={[
              { name: 'Parameter', show: (one) => one.name },
              { name: 'Value', show: (one) => one.value, number: true },
              { name: 'Standard deviation', show: (one) => one.deviation, number: true },
            ]}
            rows={cameraRows(line)}
            keyOf={(one) => one.name}
          />
        </>
      )}
      <p>
        <a href={api.jobFileAddress(props.id, 'camera.yaml')} download="camera.yaml">
          Download camera.yaml
        </a>
      </p>
      <Table
        caption="Views, largest error first"
        columns={[
          { name: 'Image', show: (one: View) => one.image },
          {
            name: 'Error',
            show: (one) => (
              <span class="bar-cell">
                <meter min={0} max={worst} value={one.rms} aria-label={`Error of ${one.image}`} />
                {one.rms.toFixed(3)} px
              </span>
            ),
          },
          { name: 'Tilt, degrees', show: (one) => one.tilt.toFixed(0), number: true },
          { name: 'Points', show: (one) => one.points, number: true },
        ]}
        rows={used}
        keyOf={(one) => one.image}
      />
      {left.length > 0 && (
        <details>
          <summary>{left.length} images were not used</summary>
          <Table
            caption="Images that were not used"
            hideCaption
            columns={[
              { name: 'Image', show: (one: View) => one.image },
              { name: 'Reason', show: (one) => one.reason },
            ]}
            rows={left}
            keyOf={(one) => one.image}
          />
        </details>
      )}
      {props.files.includes('drawn/coverage.png') && (
        <figure class="image">
          <img
            src={api.jobFileAddress(props.id, 'drawn/coverage.png')}
            alt="Image area covered by the views"
          />
          <figcaption>Image area covered by the views</figcaption>
        </figure>
      )}
      {drawn.length > 0 && (
        <details>
          <summary>Views with detected corners; residuals in red, enlarged 20 times</summary>
          <ul class="thumbs">
            {drawn.slice(0, 24).map((one) => (
              <li key={one}>
                <a href={api.jobFileAddress(props.id, one)}>
                  <img
                    src={api.jobFileAddress(props.id, one)}
                    alt={`View ${one.split('/').pop()}`}
                    width={160}
                    height={120}
                    loading="lazy"
                  />
                </a>
              </li>
            ))}
          </ul>
        </details>
      )}
    </section>
  );
}
