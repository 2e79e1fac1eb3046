// A box that cuts a part out of a cloud. Its axes are those of the upright view: x to the right, y up, z to the viewer
// of the first view. Pure.
import type { Cloud } from './colmap';
import { upOf, type Model } from './model';
import { rotate, upright, type Vector } from './orbit';

export interface Box {
  low: [number, number, number];
  high: [number, number, number];
}

export const axes = [
  { name: 'x', words: 'across' },
  { name: 'y', words: 'up' },
  { name: 'z', words: 'deep' },
] as const;

// The positions of a cloud, turned so that up is up, as the model's cameras have it.
export function uprightPositions(model: Model, { positions, count }: Cloud): Float32Array<ArrayBuffer> {
  const rotation = upright(upOf(model.images.values()));
  const result = new Float32Array(3 * count);
  for (let i = 0; i < count; i++)
    result.set(rotate(rotation, [positions[3 * i]!, positions[3 * i + 1]!, positions[3 * i + 2]!]), 3 * i);
  return result;
}

// The box of all points that are numbers; of none, a point.
export function wholeBox(positions: Float32Array): Box {
  const low: Box['low'] = [Infinity, Infinity, Infinity];
  const high: Box['high'] = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    const value = positions[i]!;
    if (!Number.isFinite(value)) continue;
    const axis = i % 3;
    if (value < low[axis]!) low[axis] = value;
    if (value > high[axis]!) high[axis] = value;
  }
  for (let axis = 0; axis < 3; axis++) {
    if (low[axis]! > high[axis]!) low[axis] = high[axis] = 0;
  }
  return { low, high };
}

// Where a box begins: around the middle, without what lies far away.
export function firstBox(positions: Float32Array): Box {
  const whole = wholeBox(positions);
  const count = Math.floor(positions.length / 3);
  if (count < 10) return whole;
  const step = Math.max(1, Math.floor(count / 20000));
  const low = [...whole.low] as Box['low'];
  const high = [...whole.high] as Box['high'];
  for (let axis = 0; axis < 3; axis++) {
    const values: number[] = [];
    for (let i = 0; i < count; i += step) values.push(positions[3 * i + axis]!);
    values.sort((a, b) => a - b);
    low[axis] = values[Math.floor(0.1 * (values.length - 1))]!;
    high[axis] = values[Math.ceil(0.9 * (values.length - 1))]!;
  }
  return { low, high };
}

export function isInside(positions: Float32Array, box: Box, index: number): boolean {
  for (let axis = 0; axis < 3; axis++) {
    const value = positions[3 * index + axis]!;
    // Not a number is in no box.
    if (!(value >= box.low[axis]! && value <= box.high[axis]!)) return false;
  }
  return true;
}

export function countInside(positions: Float32Array, box: Box): number {
  let count = 0;
  for (let i = 0; i < Math.floor(positions.length / 3); i++) if (isInside(positions, box, i)) count += 1;
  return count;
}

// With one of the six faces moved. It stays within the whole box, and the faces never pass each other.
export function moveFace(box: Box, whole: Box, axis: number, face: 'low' | 'high', value: number): Box {
  if (!Number.isFinite(value)) return box;
  const low = [...box.low] as Box['low'];
  const high = [...box.high] as Box['high'];
  const held = Math.min(whole.high[axis]!, Math.max(whole.low[axis]!, value));
  if (face === 'low') low[axis] = Math.min(held, high[axis]!);
  else high[axis] = Math.max(held, low[axis]!);
  return { low, high };
}

// One of the six faces, by the handle in its middle.
export interface Face {
  axis: number;
  face: 'low' | 'high';
}

export const faces: readonly Face[] = [0, 1, 2].flatMap((axis) => [
  { axis, face: 'low' as const },
  { axis, face: 'high' as const },
]);

// "x-low", as the page and its tests call it.
export const nameOfFace = ({ axis, face }: Face): string => `${axes[axis]!.name}-${face}`;

// The middle of a face.
export function handleOf(box: Box, { axis, face }: Face): Vector {
  const middle = [0, 1, 2].map((i) => (box.low[i]! + box.high[i]!) / 2) as Vector;
  middle[axis] = box[face][axis]!;
  return middle;
}

// Where a point is seen, px from the top left, and its distance along the view; null behind the eye.
// `matrix` takes a point to clip space, column by column.
export function seenAt(
  [x, y, z]: Vector,
  matrix: readonly number[],
  width: number,
  height: number,
): { x: number; y: number; away: number } | null {
  const m = matrix;
  const w = m[3]! * x + m[7]! * y + m[11]! * z + m[15]!;
  if (!(w > 0)) return null;
  return {
    x: ((m[0]! * x + m[4]! * y + m[8]! * z + m[12]!) / w + 1) * 0.5 * width,
    y: (1 - (m[1]! * x + m[5]! * y + m[9]! * z + m[13]!) / w) * 0.5 * height,
    away: w,
  };
}

// The face whose handle a pointer at (x, y) means: within `reach` px, the nearest to the eye; null: none.
export function faceAt(
  box: Box,
  matrix: readonly number[],
  width: number,
  height: number,
  x: number,
  y: number,
  reach: number,
): Face | null {
  let best: Face | null = null;
  let nearest = Infinity;
  for (const one of faces) {
    const seen = seenAt(handleOf(box, one), matrix, width, height);
    if (!seen || Math.hypot(seen.x - x, seen.y - y) > reach || seen.away >= nearest) continue;
    nearest = seen.away;
    best = one;
  }
  return best;
}

// How far along an axis through `at` the point is that comes nearest to a ray of sight; null where the two are nearly
// parallel, as no movement of the pointer means one along the axis then. `ray`: of any length.
export function alongAxis(at: Vector, axis: number, eye: Vector, ray: Vector): number | null {
  const length = Math.hypot(...ray);
  const d = ray.map((v) => v / length) as Vector;
  const cosine = d[axis]!;
  const sine2 = 1 - cosine * cosine;
  if (!(sine2 > 0.01)) return null;
  const between = at.map((v, i) => v - eye[i]!) as Vector;
  const onRay = between[0] * d[0] + between[1] * d[1] + between[2] * d[2];
  return (cosine * onRay - between[axis]!) / sine2;
}

// What a key means to the box, where there is one: x, y and z choose a face of the axis (the upper one first, then the
// lower one), "." and "," move it along the axis, with Shift (">" and "<") ten steps at a time, Escape lets go of it.
export function keyedFace(
  key: string,
  chosen: Face | null,
): { chosen: Face | null; steps: number } | undefined {
  const axis = ['x', 'y', 'z'].indexOf(key.toLowerCase());
  if (axis >= 0) {
    const face = chosen?.axis === axis && chosen.face === 'high' ? 'low' : 'high';
    return { chosen: { axis, face }, steps: 0 };
  }
  if (!chosen) return undefined;
  const steps = { '.': 1, ',': -1, '>': 10, '<': -10 }[key];
  if (steps !== undefined) return { chosen, steps };
  return key === 'Escape' ? { chosen: null, steps: 0 } : undefined;
}

// The twelve edges as pairs of points.
export function edgesOf(box: Box): Float32Array {
  const corner = (n: number) =>
    [0, 1, 2].map((axis) => ((n >> axis) & 1 ? box.high[axis]! : box.low[axis]!)) as [number, number, number];
  const all: number[] = [];
  for (let n = 0; n < 8; n++)
    for (let axis = 0; axis < 3; axis++)
      if (((n >> axis) & 1) === 0) all.push(...corner(n), ...corner(n | (1 << axis)));
  return new Float32Array(all);
}

// A step that makes about 200 of the whole length, as a round number.
export function stepOf(length: number): number {
  if (!(length > 0)) return 0.001;
  return 10 ** Math.floor(Math.log10(length / 50));
}
