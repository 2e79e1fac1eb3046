// A box that cuts a part out of a cloud. Its axes are those of the upright view: x to the right, y up, z to the viewer
// of the first view. Pure.
import { upOf, type Model } from './model';
import { rotate, upright } from './orbit';

export interface Box {
  low: [number, number, number];
  high: [number, number, number];
}

export const axes = [
  { name: 'x', words: 'across' },
  { name: 'y', words: 'up' },
  { name: 'z', words: 'deep' },
] as const;

// The positions of the cloud, turned so that up is up.
export function uprightPositions(model: Model): Float32Array<ArrayBuffer> {
  const rotation = upright(upOf(model.photographs.values()));
  const { positions, count } = model.cloud;
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
