// The model in 3D: its points, or the dense cloud or the surface made of it, with what can be asked of them.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { api, errorText, type Job } from '../../api';
import { bytesText } from '../../format';
import { Button, Checkbox, Notice, Progress, Select, Slider, Table, TextField } from '../../ui';
import { save } from '../shared/files';
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
import { PointView } from './point_view';
import type { CloudViewer, Place, Shape } from './viewer';

type Mode = 'look' | 'measure';

const sizeOf = (job: Job, name: string): string => {
  const file = job.files.find((one) => one.name === name);
  return file ? `, ${bytesText(file.bytes)}` : '';
};

// What can be shown of a job's model: its points, and what was made of them.
const kinds = {
  points: { label: 'Sparse points', file: 'model/points3D.txt' },
  dense: { label: 'Dense cloud', file: 'model/dense/fused.ply' },
  surface: { label: 'Surface', file: 'model/mesh.glb' },
} as const;
type Kind = keyof typeof kinds;
type Loaded = Shape & { kind: Kind };

// What the job made beyond the points, read when it is asked for.
function useShape(job: Job, model: Model, kind: Kind): { shape: Loaded; problem: string } {
  const [made, setMade] = useState<Loaded>({ kind: 'points', cloud: model.cloud });
  const [problem, setProblem] = useState('');
  useEffect(() => {
    setProblem('');
    if (kind === 'points') {
      setMade({ kind, cloud: model.cloud });
      return undefined;
    }
    const stop = new AbortController();
    const address = api.jobFileAddress(job.id, kinds[kind].file);
    import('./worker')
      .then(async ({ readCloud, readSurface }): Promise<Loaded> => {
        if (kind === 'dense') return { kind, cloud: await readCloud(address, stop.signal) };
        const surface = await readSurface(address, stop.signal);
        return { kind, cloud: surface.cloud, surface };
      })
      .then(setMade, (why: unknown) => {
        if (!stop.signal.aborted) setProblem(errorText(why));
      });
    return () => stop.abort();
  }, [job.id, model, kind]);
  return { shape: made, problem };
}

export function CloudPanel({ job, model }: { job: Job; model: Model }) {
  const [kind, setKind] = useState<Kind>('points');
  const { shape, problem } = useShape(job, model, kind);
  const { cloud } = shape;
  const offered = (Object.keys(kinds) as Kind[]).filter(
    (one) => one === 'points' || job.files.some((file) => file.name === kinds[one].file),
  );
  const canvas = useRef<HTMLCanvasElement>(null);
  const viewer = useRef<CloudViewer | undefined>(undefined);
  const [noCanvas, setNoCanvas] = useState('');
  const [size, setSize] = useState(3);
  const [showCameras, setShowCameras] = useState(true);
  const [mode, setMode] = useState<Mode>('look');
  const [picked, setPicked] = useState<Place[]>([]);
  const [scale, setScale] = useState<number | null>(null);
  const [known, setKnown] = useState('');
  const [unit, setUnit] = useState('m');
  const positions = useMemo(() => uprightPositions(model, cloud), [model, cloud]);
  const whole = useMemo(() => wholeBox(positions), [positions]);
  const [box, setBox] = useState<Box | null>(null);
  const [only, setOnly] = useState(false);
  const inside = useMemo(() => (box ? countInside(positions, box) : 0), [box, positions]);
  const [chosen, setChosen] = useState<Face | null>(null);
  const [ready, setReady] = useState(false);
  const pick = useRef<(place: Place) => void>(() => undefined);
  const measures = mode === 'measure' || shape.kind !== 'points';
  pick.current = (place) =>
    setPicked((before) => (measures && before.length === 1 ? [before[0]!, place] : [place]));
  const bounds = useRef(whole);
  bounds.current = whole;

  useEffect(() => {
    let alive = true;
    import('./viewer').then(
      ({ CloudViewer }) => {
        if (!alive || !canvas.current) return;
        try {
          const one = new CloudViewer(canvas.current);
          one.onPick = (place) => pick.current(place);
          one.onTexture = () => {
            if (canvas.current) canvas.current.dataset['texture'] = 'shown';
          };
          one.onFrame = (ms, drawn) => {
            if (!canvas.current) return;
            canvas.current.dataset['drawn'] = String(drawn);
            canvas.current.dataset['ms'] = ms.toFixed(0);
            canvas.current.dataset['handles'] = JSON.stringify(one.handlePlaces());
          };
          one.onFace = ({ axis, face }, value) =>
            setBox((before) => before && moveFace(before, bounds.current, axis, face, value));
          one.onChosen = setChosen;
          viewer.current = one;
          setReady(true);
        } catch {
          setNoCanvas('This browser cannot draw in 3D (no WebGL). The tables below show the same content.');
        }
      },
      () => setNoCanvas('The 3D viewer could not be loaded.'),
    );
    return () => {
      alive = false;
      viewer.current?.dispose();
      viewer.current = undefined;
      setReady(false);
    };
  }, []);
  // In this order: what is shown, then the box around it and the marks on it.
  useEffect(() => {
    if (!ready) return;
    viewer.current?.show(model, shape, positions, size);
    if (canvas.current) {
      canvas.current.dataset['shown'] = shape.kind;
      delete canvas.current.dataset['texture'];
    }
    setPicked([]);
  }, [ready, model, shape, positions]);
  useEffect(
    () => viewer.current?.cut(box ?? undefined, only, whole),
    [ready, shape, positions, box, only, whole],
  );
  useEffect(() => viewer.current?.mark(picked), [ready, picked]);

  const [from, to] = picked;
  const length = from && to ? Math.hypot(...from.at.map((v, i) => v - to.at[i]!)) : null;
  const knownLength = Number(known);
  return (
    <div class="cloud">
      <div class="cloud-image">
        <canvas
          ref={canvas}
          role="application"
          aria-roledescription="cloud of points"
          aria-label={`${shape.surface ? `Surface of ${shape.surface.faces.length / 3} triangles` : `Cloud of ${cloud.count} points`} and ${model.images.size} cameras. Arrow keys rotate it, plus and minus zoom, Shift with arrow keys pans, 0 resets the view.${box ? ' x, y and z select a face of the cut box, point and comma move it.' : ''}`}
          tabIndex={0}
        />
        {noCanvas && <p class="live-wait">{noCanvas}</p>}
      </div>
      <div class="cloud-side stack">
        <div class="view-buttons" role="group" aria-label="View">
          <Button small aria-label="Rotate left" onClick={() => viewer.current?.turn(-Math.PI / 12, 0)}>
            ←
          </Button>
          <Button small aria-label="Rotate right" onClick={() => viewer.current?.turn(Math.PI / 12, 0)}>
            →
          </Button>
          <Button small aria-label="Rotate up" onClick={() => viewer.current?.turn(0, Math.PI / 18)}>
            ↑
          </Button>
          <Button small aria-label="Rotate down" onClick={() => viewer.current?.turn(0, -Math.PI / 18)}>
            ↓
          </Button>
          <Button small aria-label="Zoom in" onClick={() => viewer.current?.zoom(0.8)}>
            +
          </Button>
          <Button small aria-label="Zoom out" onClick={() => viewer.current?.zoom(1.25)}>
            −
          </Button>
          <Button small onClick={() => viewer.current?.reset()}>
            Reset view
          </Button>
        </div>
        {offered.length > 1 && (
          <Select
            label="Show"
            value={kind}
            options={offered.map((one) => ({
              value: one,
              label: `${kinds[one].label}${sizeOf(job, kinds[one].file)}`,
            }))}
            onChange={(value) => setKind(value as Kind)}
          />
        )}
        {problem && <Notice kind="problem">{problem}</Notice>}
        {shape.kind !== kind && !problem && (
          <Progress label={`Loading: ${kinds[kind].label}`} done={0} total={0} />
        )}
        {!shape.surface && (
          <Slider
            label="Point size"
            value={size}
            low={1}
            high={8}
            step={1}
            onChange={(value) => {
              setSize(value);
              viewer.current?.setPointSize(value);
            }}
          />
        )}
        <Checkbox
          label="Show cameras"
          checked={showCameras}
          onChange={(shown) => {
            setShowCameras(shown);
            viewer.current?.showCameras(shown);
          }}
        />
        {shape.kind === 'points' && (
          <Select
            label="A click on a point"
            value={mode}
            options={[
              { value: 'look', label: 'shows the point in the images' },
              { value: 'measure', label: 'measures a distance' },
            ]}
            onChange={(value) => {
              setMode(value as Mode);
              setPicked([]);
            }}
          />
        )}
        <PointByNumber
          label={shape.surface ? 'Or vertex number' : 'Or point number'}
          count={cloud.count}
          onPick={(index) =>
            pick.current({
              at: [0, 1, 2].map((axis) => cloud.positions[3 * index + axis]!) as Place['at'],
              index: shape.surface ? null : index,
            })
          }
        />
        {measures && (
          <div class="stack" aria-live="polite">
            <p>
              {length === null
                ? picked.length === 0
                  ? 'To measure, click the first point.'
                  : 'Click the second point.'
                : `Distance: ${lengthText(length, scale, unit)}`}
            </p>
            {length !== null && (
              <div class="row row-fields">
                <TextField
                  label="Real distance"
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
                  Set the scale
                </Button>
              </div>
            )}
            {scale !== null && (
              <p>
                One unit of the model is {scale.toPrecision(4)} {unit}.{' '}
                <Button small onClick={() => setScale(null)}>
                  Reset the scale
                </Button>
              </p>
            )}
          </div>
        )}
        <Table
          caption="Properties of the cloud"
          columns={[
            { name: 'Property', show: (row) => row[0]! },
            { name: 'Value', show: (row) => row[1]!, number: true },
          ]}
          rows={[
            ...(shape.surface
              ? [
                  ['Triangles', String(shape.surface.faces.length / 3)],
                  ['Corners', String(cloud.count)],
                ]
              : [['Points', String(cloud.count)]]),
            ['Cameras', String(model.images.size)],
            ['Size, units of the model', boxText(cloud.positions)],
            ...(model.skipped > 0 ? [['Skipped lines', String(model.skipped)]] : []),
          ]}
          keyOf={(row) => row[0]!}
          hideCaption
        />
        <Checkbox
          label="Cut box"
          checked={box !== null}
          onChange={(on) => setBox(on ? firstBox(positions) : null)}
          help="Selects a part of the cloud to view and download."
        />
        {box && (
          <CutPanel
            box={box}
            whole={whole}
            inside={inside}
            count={cloud.count}
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
                new Blob([writePly(cloud, (i) => isInside(positions, box, i), scale ?? 1) as BlobPart]),
              )
            }
          />
        )}
        {!shape.surface && (
          <Button
            onClick={() =>
              save('points.ply', new Blob([writePly(cloud, () => true, scale ?? 1) as BlobPart]))
            }
          >
            {scale === null ? 'Download the cloud (PLY)' : `Download the cloud in ${unit} (PLY)`}
          </Button>
        )}
        {shape.kind !== 'points' && (
          <a href={api.jobFileAddress(job.id, kinds[shape.kind].file)} download>
            {shape.surface ? 'Download the surface (GLB)' : 'Download the original file (PLY, with normals)'}
          </a>
        )}
      </div>
      {!measures && typeof from?.index === 'number' && (
        <PointView job={job} model={model} index={from.index} />
      )}
    </div>
  );
}

// The way to a point without a mouse.
function PointByNumber(props: { label: string; count: number; onPick: (index: number) => void }) {
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
        label={`${props.label}, 1 to ${props.count}`}
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
