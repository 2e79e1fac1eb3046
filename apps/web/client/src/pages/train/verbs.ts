// The verbs that train and evaluate, and their inputs: pure.
import type { Flags } from '../../api';
import { capital, numberText, withUnit } from '../../format';

export type DataKind = 'points' | 'plates' | 'heads' | 'gallery';

export interface TrainVerb {
  verb: string;
  title: string;
  data: DataKind;
  only: readonly string[];
  output: string; // name of the model
  place?: string; // the model that ships and whose place it can take
}

export const trainVerbs: readonly TrainVerb[] = [
  {
    verb: 'landmarks train tracker',
    title: 'Landmarks: a tracker, all parts in one file',
    data: 'points',
    only: [
      '--hold-out',
      '--mirror',
      '--turned',
      '--trees',
      '--depth',
      '--levels',
      '--modes',
      '--patch',
      '--seed',
    ],
    output: 'tracker.json',
    place: 'landmarks68',
  },
  {
    verb: 'landmarks train shape',
    title: 'Landmarks: the shape model only',
    data: 'points',
    only: ['--hold-out', '--mirror', '--variance', '--modes'],
    output: 'shape.json',
  },
  {
    verb: 'landmarks train face-detector',
    title: 'Landmarks: a detector of the annotated object',
    data: 'points',
    only: ['--hold-out', '--window', '--c', '--epsilon', '--upsample', '--mirror'],
    output: 'detector.json',
  },
  {
    verb: 'aam train',
    title: 'Appearance model',
    data: 'points',
    only: [
      '--hold-out',
      '--channels',
      '--width',
      '--levels',
      '--variance',
      '--modes',
      '--texture-modes',
      '--mirror',
    ],
    output: 'aam.json',
    place: 'aam68',
  },
  {
    verb: 'pose train-head',
    title: 'Head model in 3D, from landmarks of turned faces',
    data: 'points',
    only: ['--modes', '--iterations', '--outer-eye-mm', '--distance-mm'],
    output: 'head.json',
    place: 'head',
  },
  {
    verb: 'pose train-view',
    title: 'Head pose correction, from images with known poses',
    data: 'heads',
    only: ['--leave-out', '--components', '--angle-weight', '--ridge', '--focal'],
    output: 'view.json',
    place: 'head-view',
  },
  {
    verb: 'plate train-detector',
    title: 'Plates: the detector',
    data: 'plates',
    only: ['--steps', '--aligner-steps', '--seed'],
    output: 'detector.json',
    place: 'plate-detector',
  },
  {
    verb: 'plate train-reader',
    title: 'Plates: the reader of characters',
    data: 'plates',
    only: ['--steps', '--calibration', '--hold-out', '--seed'],
    output: 'reader.json',
    place: 'plate-reader',
  },
  {
    verb: 'people train',
    title: 'People: retrain on the gallery',
    data: 'gallery',
    only: ['--algorithm'],
    output: '',
  },
];

export interface EvalVerb {
  verb: string;
  title: string;
  data: DataKind;
  model: string; // the flag
  trains: string; // the verb whose models it evaluates
  only: readonly string[];
}

export const evalVerbs: readonly EvalVerb[] = [
  {
    verb: 'landmarks eval',
    title: 'Landmarks',
    data: 'points',
    model: '--model',
    trains: 'landmarks train tracker',
    only: ['--held-out', '--eyes', '--method', '--starts', '--min-face'],
  },
  {
    verb: 'aam eval',
    title: 'Appearance model',
    data: 'points',
    model: '--model',
    trains: 'aam train',
    only: ['--held-out', '--eyes', '--method', '--start', '--limit'],
  },
  {
    verb: 'plate eval',
    title: 'Plates, detector',
    data: 'plates',
    model: '--detector',
    trains: 'plate train-detector',
    only: ['--iou', '--country', '--min-confidence', '--fold'],
  },
  {
    verb: 'plate eval',
    title: 'Plates, reader',
    data: 'plates',
    model: '--reader',
    trains: 'plate train-reader',
    only: ['--iou', '--country', '--min-confidence', '--fold'],
  },
  {
    verb: 'pose eval',
    title: 'Head poses',
    data: 'heads',
    model: '--head',
    trains: 'pose train-head',
    only: ['--method', '--refine', '--focal'],
  },
];

// What is asked of the program for data of a kind: inputs and flags.
export function trainRequest(
  verb: TrainVerb,
  data: string,
  flags: Flags,
): { inputs: string[]; flags: Flags } {
  const output: Flags = verb.output === '' ? {} : { '--output': `out:${verb.output}` };
  if (verb.data === 'gallery') return { inputs: [], flags: { ...flags } };
  if (verb.verb === 'pose train-view') return { inputs: [], flags: { ...flags, ...output, '--truth': data } };
  if (verb.verb === 'plate train-reader')
    return { inputs: [], flags: { ...flags, ...output, '--scenes': data } };
  return { inputs: [data], flags: { ...flags, ...output } };
}

// The name of the model that ships whose place a model of this training verb takes, or undefined.
export const shippedModelOf = (verb: string): string | undefined =>
  trainVerbs.find((one) => one.verb === verb)?.place;

// `model`: a reference; null for the one that ships, by its name, so that no model of the user's own is taken for it.
export function evalRequest(
  verb: EvalVerb,
  data: string,
  model: string | null,
  flags: Flags,
): { inputs: string[]; flags: Flags } {
  const all: Flags = { ...flags };
  const place = shippedModelOf(verb.trains);
  if (model !== null) all[verb.model] = model;
  else if (place !== undefined) all[verb.model] = `model:${place}`;
  if (verb.verb === 'pose eval')
    return { inputs: [], flags: { ...all, '--truth': data, '--output': 'out:found.jsonl' } };
  if (verb.verb === 'plate eval') {
    return {
      inputs: [`${data}/images`],
      flags: { ...all, '--truth': `${data}/truth.csv`, '--csv': 'out:cases.csv', '--errors': true },
    };
  }
  return { inputs: [data], flags: { ...all, '--csv': 'out:cases.csv', '--output': 'out:found.jsonl' } };
}

// The job that draws data of a kind, and the reference of its result.
export function synthRequest(
  kind: DataKind,
): { verb: string; inputs: string[]; flags: Flags; result: string } | null {
  if (kind === 'points' || kind === 'heads') {
    return {
      verb: 'pose synth',
      inputs: [],
      flags: { '--output': 'out:heads', '--count': 60, '--size': '320x240', '--near': 450, '--far': 500 },
      result: kind === 'points' ? 'heads/set.json' : 'heads/truth.jsonl',
    };
  }
  if (kind === 'plates') {
    return {
      verb: 'plate synth',
      inputs: [],
      flags: { '--output': 'out:cars', '--count': 20 },
      result: 'cars',
    };
  }
  return null;
}

// Of the files of a job those that are data of a kind, as paths below it.
export function dataOfJob(kind: DataKind, files: readonly string[]): string[] {
  if (kind === 'points') return files.filter((name) => /(^|\/)set\.(json|yaml)$/.test(name));
  if (kind === 'heads')
    return files.filter(
      (name) => /(^|\/)truth\.jsonl$/.test(name) && files.some((one) => one.endsWith('set.json')),
    );
  if (kind === 'plates') {
    return files
      .filter((name) => /\/truth\.csv$/.test(name))
      .map((name) => name.replace(/\/truth\.csv$/, ''));
  }
  return [];
}

// Units and words for the numbers that eval verbs print.
const metricLabels: Record<string, string> = {
  image: 'Image',
  nme: 'Error, %',
  dx: 'Offset to the right, %',
  dy: 'Offset downwards, %',
  error: 'Residual',
  text: 'Reading',
  found: 'Found',
  confidence: 'Confidence',
  edits: 'Wrong characters',
  faces: 'Faces',
  missed: 'Not found',
  wrong: 'Another face',
  seen: 'Face seen',
  tilt: 'True tilt, degrees',
  pan: 'True pan, degrees',
  pitch: 'Pitch, degrees',
  yaw: 'Yaw, degrees',
  roll: 'Roll, degrees',
  nme_mean: 'Mean error, % of the eye distance',
  nme_median: 'Median error, % of the eye distance',
  nme_p90: '90th percentile of the error, %',
  failures: 'Share of failures',
  auc_8: 'Area under the curve up to 8 %',
  bias_x: 'Bias to the right, %',
  bias_y: 'Bias downwards, %',
  within: 'Share within the limit',
  limit: 'Limit, %',
  iterations: 'Iterations of a fit',
  ms: 'ms each',
  images: 'Images',
  truth: 'True plates',
  recall: 'Share found',
  prec: 'Share of detections that are plates',
  exact: 'Share read exactly',
  exact_o_as_0: 'Share read exactly, O as 0',
  char: 'Share of correct characters',
  calibration_error: 'Calibration error of the confidence',
  median_ms: 'Median time, ms',
  p90_ms: '90th percentile of the time, ms',
  answered: 'Answered',
  pitch_mae: 'Mean pitch error, degrees',
  yaw_mae: 'Mean yaw error, degrees',
  roll_mae: 'Mean roll error, degrees',
  rotation_mean: 'Mean rotation error, degrees',
  rotation_median: 'Median rotation error, degrees',
  translation_percent: 'Error of the distance, %',
};

export const metricLabel = (name: string): string => metricLabels[name] ?? capital(withUnit(name));

// The same of one case, where the word of a set does not fit it.
export const caseLabel = (name: string): string =>
  name === 'exact' ? 'Read exactly' : name === 'outcome' ? 'Outcome' : metricLabel(name);

const outcomes = ['missed', 'wrong', 'lost', 'found'];
// What is not known of a case where nothing was found; the program writes 0 then.
const detectionColumns = [
  ...['text', 'confidence', 'edits', 'exact', 'nme', 'dx', 'dy', 'error', 'iterations'],
  ...['pitch', 'yaw', 'roll'],
];

// Whether nothing was detected: no face, no plate.
export const isMissed = (row: Record<string, string>): boolean => row.missed === '1' || row.found === '0';

// The columns of a table of cases: what became of each is one column, behind the image.
export function caseColumns(names: readonly string[]): string[] {
  const others = names.filter((name) => !outcomes.includes(name));
  return others.length === names.length ? others : [others[0] ?? '', 'outcome', ...others.slice(1)];
}

// A cell of such a table for people.
export function caseCell(row: Record<string, string>, name: string): string {
  const value = row[name] ?? '';
  if (name === 'image') return value.split('/').pop() ?? '';
  if (name === 'outcome') {
    if (isMissed(row)) return 'not found';
    return row.wrong === '1' ? 'another face' : row.lost === '1' ? 'lost' : 'found';
  }
  if (isMissed(row) && detectionColumns.includes(name)) return '–';
  if (name === 'exact' || name === 'seen') return value === '1' ? 'yes' : 'no';
  if (name === 'confidence' && value !== '') return `${(100 * Number(value)).toFixed(0)} %`;
  return /^-?\d+\.\d{3,}$/.test(value) ? numberText(Number(value), 2) : value;
}

// Figures in an order that people expect: what is known above, the others by name.
export function sortMetrics<T extends { name: string }>(rows: readonly T[]): T[] {
  const order = Object.keys(metricLabels);
  const place = (name: string) => (order.includes(name) ? order.indexOf(name) : order.length);
  return [...rows].sort((a, b) => place(a.name) - place(b.name) || a.name.localeCompare(b.name));
}
