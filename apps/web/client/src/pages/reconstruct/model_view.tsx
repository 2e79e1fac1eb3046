// One model: its cloud, its images with reasons, measures, downloads.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { api, errorText, type Job } from '../../api';
import { bytesText } from '../../format';
import { useLoad } from '../../hooks';
import { Button, Checkbox, Notice, Progress, Select, Slider, Table, TextField } from '../../ui';
import { save } from '../shared/files';
import { jobJson } from '../shared/jobs';
import { observationsOf, type Observation } from './colmap';
import {
  countInside,
  firstBox,
  isInside,
  moveFace,
  uprightPositions,
  wholeBox,
  type Box,
  type Face,
} from './cut_box';
import { CutPanel } from './cut_panel';
import { boxText, type Model } from './model';
import { lengthText } from './orbit';
import { writePly } from './ply';
import type { CloudViewer } from './viewer';

interface Report {
  models: {
    photographs: number;
    points: number;
    observations: number;
    mean_track: number;
    reprojection_px: number;
  }[];
  photographs: {
    name: string;
    registered: boolean;
    model?: number;
    points?: number;
    reason?: string;
    read?: boolean;
  }[];
  partial?: boolean;
  not_placed?: string;
  log?: string[];
}

type Mode = 'look' | 'measure';

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

export function ModelView({ job }: { job: Job }) {
  const report = useLoad(() => jobJson<Report>(job.id, 'model/report.json'), [job.id]);
  const [model, setModel] = useState<Model | null>(null);
  const [problem, setProblem] = useState('');
  useEffect(() => {
    const stop = new AbortController();
    const at = (file: string) => api.jobFileAddress(job.id, `model/${file}`);
    import('./worker')
      .then(({ readModel }) =>
        readModel(
          { cameras: at('cameras.txt'), images: at('images.txt'), points: at('points3D.txt') },
          stop.signal,
        ),
      )
      .then(setModel, (why: unknown) => {
        if (!stop.signal.aborted) setProblem(errorText(why));
      });
    return () => stop.abort();
  }, [job.id]);

  const main = report.value?.models[0];
  const missing = (report.value?.photographs ?? []).filter((one) => !one.registered);
  return (
    <section class="stack" aria-labelledby="the-model">
      <h2 id="the-model">{job.name || 'The model'}</h2>
      {report.value?.partial && <Notice>The job was stopped: this is the model so far.</Notice>}
      {main && (
        <p class="numbers">
          {main.photographs} of {report.value!.photographs.length} images, {main.points} points, each in{' '}
          {main.mean_track.toFixed(1)} images, reprojection error {main.reprojection_px.toFixed(2)} px
          {report.value!.models.length > 1 ? `; ${report.value!.models.length - 1} further models` : ''}
        </p>
      )}
      {report.error && <Notice kind="problem">{report.error}</Notice>}
      {problem && <Notice kind="problem">The cloud could not be shown. {problem}</Notice>}
      {!model && !problem && <Progress label="Reading the model" done={0} total={0} />}
      {model && <Cloud job={job} model={model} />}
      {missing.length > 0 && (
        <Notice kind="problem">
          <p>
            {missing.length} {missing.length === 1 ? 'image is' : 'images are'} not in the model:
          </p>
          <ul>
            {missing.map((one) => (
              <li key={one.name}>
                {one.name}: {one.reason ?? (one.read === false ? 'could not be read' : 'no reason was given')}
              </li>
            ))}
          </ul>
        </Notice>
      )}
      {report.value && (
        <details open={missing.length > 0}>
          <summary>All images</summary>
          <Table
            caption="Images of the model"
            columns={[
              { name: 'Image', show: (one) => one.name },
              { name: 'In the model', show: (one) => (one.registered ? 'yes' : 'no') },
              { name: 'Points', show: (one) => one.points ?? '', number: true },
              { name: 'Reason', show: (one) => one.reason ?? '' },
            ]}
            rows={report.value.photographs}
            keyOf={(one) => one.name}
          />
        </details>
      )}
      {(report.value?.log?.length ?? 0) > 0 && (
        <details>
          <summary>How it grew</summary>
          <ol class="log-list">
            {report.value!.log!.map((line, i) => (
              <li key={i}>{line}</li>
            ))}
          </ol>
        </details>
      )}
      <details>
        <summary>Files for other programs</summary>
        <ul class="file-list">
          {job.files
            .filter((file) => !file.name.includes('/cache/'))
            .map((file) => (
              <li key={file.name}>
                <a href={api.jobFileAddress(job.id, file.name)} download={file.name.split('/').pop()}>
                  {file.name}
                </a>{' '}
                <span class="faint">{bytesText(file.bytes)}</span>
              </li>
            ))}
        </ul>
        <p class="field-help">
          cameras.txt, images.txt and points3D.txt are COLMAP's text model; points.ply opens in MeshLab and
          CloudCompare.
        </p>
      </details>
    </section>
  );
}

function Cloud({ job, model }: { job: Job; model: Model }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const viewer = useRef<CloudViewer | undefined>(undefined);
  const [noCanvas, setNoCanvas] = useState('');
  const [size, setSize] = useState(3);
  const [showCameras, setShowCameras] = useState(true);
  const [mode, setMode] = useState<Mode>('look');
  const [picked, setPicked] = useState<number[]>([]);
  const [scale, setScale] = useState<number | null>(null);
  const [known, setKnown] = useState('');
  const [unit, setUnit] = useState('m');
  const positions = useMemo(() => uprightPositions(model), [model]);
  const whole = useMemo(() => wholeBox(positions), [positions]);
  const [box, setBox] = useState<Box | null>(null);
  const [only, setOnly] = useState(false);
  const inside = useMemo(() => (box ? countInside(positions, box) : 0), [box, positions]);
  const [chosen, setChosen] = useState<Face | null>(null);
  useEffect(() => viewer.current?.cut(box ?? undefined, only, whole), [box, only, whole]);
  const modeNow = useRef(mode);
  modeNow.current = mode;

  useEffect(() => {
    let alive = true;
    import('./viewer').then(
      ({ CloudViewer }) => {
        if (!alive || !canvas.current) return;
        try {
          const one = new CloudViewer(canvas.current);
          one.onPick = (index) =>
            setPicked((before) =>
              modeNow.current === 'measure' && before.length === 1 ? [before[0]!, index] : [index],
            );
          one.onFrame = (ms, drawn) => {
            if (!canvas.current) return;
            canvas.current.dataset['drawn'] = String(drawn);
            canvas.current.dataset['ms'] = ms.toFixed(0);
            canvas.current.dataset['handles'] = JSON.stringify(one.handlePlaces());
          };
          one.onFace = ({ axis, face }, value) =>
            setBox((before) => before && moveFace(before, whole, axis, face, value));
          one.onChosen = setChosen;
          one.show(model, positions, 3);
          viewer.current = one;
        } catch {
          setNoCanvas('This browser cannot draw in 3D (no WebGL). The tables below have the same content.');
        }
      },
      () => setNoCanvas('The part of the page that draws in 3D did not load.'),
    );
    return () => {
      alive = false;
      viewer.current?.dispose();
      viewer.current = undefined;
    };
  }, [model]);
  useEffect(() => viewer.current?.mark(picked), [picked]);

  const place = (i: number) => [0, 1, 2].map((axis) => model.cloud.positions[3 * i + axis]!);
  const length =
    picked.length === 2 ? Math.hypot(...place(picked[0]!).map((v, i) => v - place(picked[1]!)[i]!)) : null;
  const knownLength = Number(known);
  return (
    <div class="cloud">
      <div class="cloud-image">
        <canvas
          ref={canvas}
          role="application"
          aria-roledescription="cloud of points"
          aria-label={`Cloud of ${model.cloud.count} points and ${model.photographs.size} cameras. Arrow keys turn it, plus and minus zoom, Shift with arrows moves it, 0 is the first view.${box ? ' x, y and z choose a face of the cut box, point and comma move it.' : ''}`}
          tabIndex={0}
        />
        {noCanvas && <p class="live-wait">{noCanvas}</p>}
      </div>
      <div class="cloud-side stack">
        <div class="view-buttons" role="group" aria-label="View">
          <Button small aria-label="Turn left" onClick={() => viewer.current?.turn(-Math.PI / 12, 0)}>
            ←
          </Button>
          <Button small aria-label="Turn right" onClick={() => viewer.current?.turn(Math.PI / 12, 0)}>
            →
          </Button>
          <Button small aria-label="Turn up" onClick={() => viewer.current?.turn(0, Math.PI / 18)}>
            ↑
          </Button>
          <Button small aria-label="Turn down" onClick={() => viewer.current?.turn(0, -Math.PI / 18)}>
            ↓
          </Button>
          <Button small aria-label="Nearer" onClick={() => viewer.current?.zoom(0.8)}>
            +
          </Button>
          <Button small aria-label="Farther" onClick={() => viewer.current?.zoom(1.25)}>
            −
          </Button>
          <Button small onClick={() => viewer.current?.reset()}>
            First view
          </Button>
        </div>
        <Slider
          label="Size of points"
          value={size}
          low={1}
          high={8}
          step={1}
          onChange={(value) => {
            setSize(value);
            viewer.current?.setPointSize(value);
          }}
        />
        <Checkbox
          label="Show the cameras"
          checked={showCameras}
          onChange={(shown) => {
            setShowCameras(shown);
            viewer.current?.showCameras(shown);
          }}
        />
        <Select
          label="A click on a point"
          value={mode}
          options={[
            { value: 'look', label: 'shows it in the images' },
            { value: 'measure', label: 'measures from point to point' },
          ]}
          onChange={(value) => {
            setMode(value as Mode);
            setPicked([]);
          }}
        />
        <PointByNumber
          count={model.cloud.count}
          mode={mode}
          onPick={(index) =>
            setPicked((before) => (mode === 'measure' && before.length === 1 ? [before[0]!, index] : [index]))
          }
        />
        {mode === 'measure' && (
          <div class="stack" aria-live="polite">
            <p>
              {length === null
                ? picked.length === 0
                  ? 'Click the first point.'
                  : 'Click the second point.'
                : `Distance: ${lengthText(length, scale, unit)}`}
            </p>
            {length !== null && (
              <div class="row row-fields">
                <TextField
                  label="It is in truth"
                  type="number"
                  min={0}
                  step="any"
                  value={known}
                  onInput={setKnown}
                />
                <TextField label="Unit" value={unit} onInput={(text) => setUnit(text.slice(0, 8))} />
                <Button
                  disabled={!(knownLength > 0) || length === 0}
                  onClick={() => setScale(knownLength / length)}
                >
                  Use as scale
                </Button>
              </div>
            )}
            {scale !== null && (
              <p>
                One unit of the model is {scale.toPrecision(4)} {unit}.{' '}
                <Button small onClick={() => setScale(null)}>
                  Forget the scale
                </Button>
              </p>
            )}
          </div>
        )}
        <Table
          caption="The cloud in numbers"
          columns={[
            { name: 'What', show: (row) => row[0]! },
            { name: 'Value', show: (row) => row[1]!, number: true },
          ]}
          rows={[
            ['Points', String(model.cloud.count)],
            ['Cameras', String(model.photographs.size)],
            ['Size, units of the model', boxText(model.cloud.positions)],
            ...(model.skipped > 0 ? [['Lines left out', String(model.skipped)]] : []),
          ]}
          keyOf={(row) => row[0]!}
          hideCaption
        />
        <Checkbox
          label="Cut box"
          checked={box !== null}
          onChange={(on) => setBox(on ? firstBox(positions) : null)}
          help="A part of the cloud, to look at by itself and to download."
        />
        {box && (
          <CutPanel
            box={box}
            whole={whole}
            inside={inside}
            count={model.cloud.count}
            only={only}
            chosen={chosen}
            unit={scale === null ? null : unit}
            scale={scale ?? 1}
            onBox={setBox}
            onOnly={setOnly}
            onReset={() => setBox(whole)}
            onSave={() =>
              save(
                'points-in-box.ply',
                new Blob([writePly(model.cloud, (i) => isInside(positions, box, i), scale ?? 1) as BlobPart]),
              )
            }
          />
        )}
        <Button
          onClick={() =>
            save('points.ply', new Blob([writePly(model.cloud, () => true, scale ?? 1) as BlobPart]))
          }
        >
          {scale === null ? 'Download the cloud (PLY)' : `Download the cloud in ${unit} (PLY)`}
        </Button>
      </div>
      {mode === 'look' && picked.length === 1 && <PointView job={job} model={model} index={picked[0]!} />}
    </div>
  );
}

// The way to a point without a mouse.
function PointByNumber(props: { count: number; mode: Mode; onPick: (index: number) => void }) {
  const [text, setText] = useState('');
  const number = Number(text);
  const good = Number.isInteger(number) && number >= 1 && number <= props.count;
  return (
    <form
      class="row row-fields"
      onSubmit={(event) => {
        event.preventDefault();
        if (good) props.onPick(number - 1);
      }}
    >
      <TextField
        label={`Or point number, 1 to ${props.count}`}
        type="number"
        min={1}
        max={props.count}
        value={text}
        onInput={setText}
      />
      <Button type="submit" disabled={!good}>
        Choose
      </Button>
    </form>
  );
}

const half = 36; // px of the image around the point

function PointView({ job, model, index }: { job: Job; model: Model; index: number }) {
  const seen = observationsOf(index, model.cloud, model.photographs, model.cameras);
  const [x, y, z] = [0, 1, 2].map((axis) => model.cloud.positions[3 * index + axis]!.toPrecision(4));
  return (
    <section class="point-view stack" aria-live="polite" aria-label="The point in the images">
      <h3>
        Point {index + 1}: seen in {seen.length} images, at {x}, {y}, {z}
      </h3>
      <p class="field-help">The cross is where it was seen, the circle where the model puts it.</p>
      <ul class="thumbs">
        {seen.slice(0, 12).map((one) => (
          <li key={one.photograph.id}>
            <Crop job={job} model={model} one={one} />
            <span>
              {one.photograph.name}:{' '}
              {one.error === null ? 'no error known' : `${one.error.toFixed(2)} px off`}
            </span>
          </li>
        ))}
      </ul>
      <Table
        caption="Observations, largest error first"
        columns={[
          { name: 'Image', show: (one: Observation) => one.photograph.name },
          { name: 'Seen at, px', show: (one) => one.seen.map((v) => v.toFixed(1)).join(', '), number: true },
          {
            name: 'Model at, px',
            show: (one) => (one.projected ? one.projected.map((v) => v.toFixed(1)).join(', ') : ''),
            number: true,
          },
          { name: 'Error, px', show: (one) => one.error?.toFixed(2) ?? '', number: true },
        ]}
        rows={seen}
        keyOf={(one) => one.photograph.id}
      />
    </section>
  );
}

function Crop({ job, model, one }: { job: Job; model: Model; one: Observation }) {
  const address = imageAddress(job, one.photograph.name);
  const camera = model.cameras.get(one.photograph.camera);
  const [x, y] = one.seen;
  if (!address || !camera) return <p class="faint">no image</p>;
  return (
    <svg
      class="crop"
      viewBox={`${x - half} ${y - half} ${2 * half} ${2 * half}`}
      role="img"
      aria-label={`The point in ${one.photograph.name}`}
    >
      <image href={address} x={0} y={0} width={camera.width} height={camera.height} />
      <path class="crop-seen" d={`M${x - 6} ${y}h4m4 0h4M${x} ${y - 6}v4m0 4v4`} />
      {one.projected && <circle class="crop-model" cx={one.projected[0]} cy={one.projected[1]} r={5} />}
    </svg>
  );
}
