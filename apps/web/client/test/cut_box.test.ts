import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  alongAxis,
  countInside,
  edgesOf,
  faceAt,
  faces,
  firstBox,
  handleOf,
  isInside,
  keyedFace,
  moveFace,
  nameOfFace,
  seenAt,
  stepOf,
  wholeBox,
  type Box,
} from '../src/pages/reconstruct/cut_box';
import { hitOf, readGlb } from '../src/pages/reconstruct/glb';
import { readPly, writePly } from '../src/pages/reconstruct/ply';
import { benchColumns, benchRows } from '../src/pages/system/bench_table';
import { compare, comparisonText } from '../src/pages/train/curves';

const positions = new Float32Array([0, 0, 0, 1, 2, 3, -1, 5, 0.5, NaN, 0, 0]);
const box: Box = { low: [-0.5, 0, 0], high: [1, 2, 3] };

test('a box counts the points inside and on its faces', () => {
  assert.equal(isInside(positions, box, 0), true);
  assert.equal(isInside(positions, box, 1), true);
  assert.equal(isInside(positions, box, 2), false);
  assert.equal(isInside(positions, box, 3), false, 'not a number is nowhere');
  assert.equal(countInside(positions, box), 2);
  assert.deepEqual(wholeBox(positions), { low: [-1, 0, 0], high: [1, 5, 3] });
  assert.deepEqual(wholeBox(new Float32Array(0)), { low: [0, 0, 0], high: [0, 0, 0] });
  assert.equal(countInside(positions, wholeBox(positions)), 3);
});

test('the initial box excludes outliers', () => {
  const many = new Float32Array(300);
  for (let i = 0; i < 100; i++) many.set([i / 100, 0, 0], 3 * i);
  many[0] = -1000;
  const first = firstBox(many);
  assert.ok(first.low[0] > 0 && first.high[0] < 1);
  assert.deepEqual(firstBox(positions), wholeBox(positions), 'of a few points the whole');
});

test('faces stay within the whole box and do not pass each other', () => {
  const whole: Box = { low: [-1, 0, 0], high: [1, 5, 3] };
  assert.deepEqual(moveFace(box, whole, 0, 'low', 0.25).low, [0.25, 0, 0]);
  assert.deepEqual(moveFace(box, whole, 0, 'low', -7).low, [-1, 0, 0]);
  assert.deepEqual(moveFace(box, whole, 0, 'low', 7).low, [1, 0, 0]);
  assert.deepEqual(moveFace(box, whole, 1, 'high', -1).high, [1, 0, 3]);
  assert.equal(moveFace(box, whole, 0, 'low', NaN), box);
  assert.deepEqual(box, { low: [-0.5, 0, 0], high: [1, 2, 3] }, 'the old one is not changed');
});

// A perspective along -z from the origin, 100 px by 100: (x, y, -1) is seen at (50 + 50 x, 50 - 50 y).
const matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0];

test('a handle is found where it is seen, the nearer one first', () => {
  assert.deepEqual(faces.map(nameOfFace), ['x-low', 'x-high', 'y-low', 'y-high', 'z-low', 'z-high']);
  const ahead: Box = { low: [-1, -1, -6], high: [1, 1, -4] };
  assert.deepEqual(handleOf(ahead, { axis: 0, face: 'high' }), [1, 0, -5]);
  assert.deepEqual(seenAt([1, 0, -5], matrix, 100, 100), { x: 60, y: 50, away: 5 });
  assert.equal(seenAt([0, 0, 5], matrix, 100, 100), null, 'behind the eye');
  assert.deepEqual(faceAt(ahead, matrix, 100, 100, 61, 51, 4), { axis: 0, face: 'high' });
  assert.deepEqual(
    faceAt(ahead, matrix, 100, 100, 50, 50, 4),
    { axis: 2, face: 'high' },
    'not the one behind',
  );
  assert.equal(faceAt(ahead, matrix, 100, 100, 90, 90, 4), null);
});

test('a drag follows the axis', () => {
  assert.ok(Math.abs(alongAxis([1, 0, -5], 0, [0, 0, 0], [2, 0, -5])! - 1) < 1e-9);
  assert.ok(Math.abs(alongAxis([0, 0, -5], 1, [0, 0, 0], [0, -3, -10])! + 1.5) < 1e-9);
  // Beside the axis: the nearest place on it.
  assert.ok(Math.abs(alongAxis([1, 0, -5], 0, [0, 0, 0], [2, 1, -5])! - 1 / 1.04 + 0) < 0.2);
  assert.equal(alongAxis([0, 0, -5], 2, [0, 0, 0], [0, 0, -1]), null, 'along the view nothing is known');
});

test('keys choose a face and move it', () => {
  assert.equal(keyedFace('.', null), undefined);
  assert.equal(keyedFace('Escape', null), undefined, "Escape is the page's");
  const first = keyedFace('x', null)!.chosen;
  assert.deepEqual(first, { axis: 0, face: 'high' });
  assert.deepEqual(keyedFace('X', first)!.chosen, { axis: 0, face: 'low' });
  assert.deepEqual(keyedFace('z', first)!.chosen, { axis: 2, face: 'high' });
  assert.deepEqual(keyedFace('<', first), { chosen: first, steps: -10 });
  assert.equal(keyedFace('.', first)!.steps, 1);
  assert.deepEqual(keyedFace('Escape', first), { chosen: null, steps: 0 });
  assert.equal(keyedFace('ArrowLeft', first), undefined);
});

test('a box has twelve edges', () => {
  const edges = edgesOf(box);
  assert.equal(edges.length, 12 * 2 * 3);
  let sum = 0;
  for (let i = 0; i < edges.length; i += 6)
    sum += Math.hypot(
      edges[i]! - edges[i + 3]!,
      edges[i + 1]! - edges[i + 4]!,
      edges[i + 2]! - edges[i + 5]!,
    );
  assert.ok(Math.abs(sum - 4 * (1.5 + 2 + 3)) < 1e-5);
  assert.equal(stepOf(10), 0.1);
  assert.ok(stepOf(0) > 0);
});

test('the saved file has the points in the box', () => {
  const cloud = {
    count: 4,
    positions,
    colours: new Uint8Array(12).fill(9),
    ids: new Uint32Array(4),
    errors: new Float32Array(4),
    trackStart: new Uint32Array(5),
    tracks: new Uint32Array(0),
  };
  const back = readPly(writePly(cloud, (i) => isInside(positions, box, i), 2));
  assert.equal(back.count, 2);
  assert.deepEqual([...back.positions], [0, 0, 0, 2, 4, 6]);
});

test('benchmark lines become a table', () => {
  const rows = benchRows([
    { bench: 'x', case: 'a', median_ms: 1.23456, us: 3, runs: 10, error: { mean_px: 0.5, note: '' } },
    'no object',
    { case: 'b', median_ms: 20, sizes: [1, 2], flag: true },
    {},
  ]);
  assert.equal(rows.length, 2);
  assert.equal(rows[0]!['median_ms'], 1.235);
  const columns = benchColumns(rows);
  assert.deepEqual(
    columns.map((one) => [one.label, one.number]),
    [
      ['Case', false],
      ['Median, ms', true],
      ['Time, µs', true],
      ['Runs', true],
      ['Error mean, px', true],
      ['Sizes', false],
      ['Flag', false],
    ],
  );
  assert.deepEqual(benchColumns([]), []);
});

test('the comparison counts the better figures', () => {
  const rows = compare({ nme_mean: 3, auc_8: 0.5, faces: 4 }, { nme_mean: 4, auc_8: 0.6, faces: 5 });
  assert.equal(comparisonText(rows), 'Of 2 figures the new model is better in 1, the shipped model in 1.');
  assert.equal(
    comparisonText(compare({ nme_mean: 3, failures: 0 }, { nme_mean: 4, failures: 0 })),
    'Of 2 figures the new model is better in 1, the shipped model in 0, equal in 1.',
  );
  assert.equal(comparisonText(compare({ faces: 1 }, { faces: 2 })), '');
});

// A .glb of one triangle, its parts as the program writes them.
function glbOf(change: (json: Record<string, unknown>) => void = () => undefined): Uint8Array {
  const binary = new Uint8Array(76);
  binary.set(new Uint8Array(new Float32Array([0, 0, 0, 2, 0, 0, 0, 2, 0]).buffer), 0);
  binary.set(new Uint8Array(new Float32Array([0, 0, 1, 0, 0, 1]).buffer), 36);
  binary.set(new Uint8Array(new Uint32Array([0, 1, 2]).buffer), 60);
  binary.set([1, 2, 3], 72);
  const json: Record<string, unknown> = {
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: 36 },
      { buffer: 0, byteOffset: 36, byteLength: 24 },
      { buffer: 0, byteOffset: 60, byteLength: 12 },
      { buffer: 0, byteOffset: 72, byteLength: 3 },
    ],
    accessors: [
      { bufferView: 0, componentType: 5126, count: 3, type: 'VEC3' },
      { bufferView: 1, componentType: 5126, count: 3, type: 'VEC2' },
      { bufferView: 2, componentType: 5125, count: 3, type: 'SCALAR' },
    ],
    images: [{ mimeType: 'image/jpeg', bufferView: 3 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, TEXCOORD_0: 1 }, indices: 2 }] }],
  };
  change(json);
  let text = JSON.stringify(json);
  while (text.length % 4 !== 0) text += ' ';
  const bytes = new Uint8Array(28 + text.length + binary.length);
  const view = new DataView(bytes.buffer);
  [0x46546c67, 2, bytes.length, text.length, 0x4e4f534a].forEach((v, i) => view.setUint32(4 * i, v, true));
  bytes.set(new TextEncoder().encode(text), 20);
  view.setUint32(20 + text.length, binary.length, true);
  view.setUint32(24 + text.length, 0x004e4942, true);
  bytes.set(binary, 28 + text.length);
  return bytes;
}

test('a surface is read from a .glb file; malformed files are refused', () => {
  const surface = readGlb(glbOf());
  assert.deepEqual([...surface.cloud.positions], [0, 0, 0, 2, 0, 0, 0, 2, 0]);
  assert.deepEqual([...surface.faces], [0, 1, 2]);
  assert.deepEqual([...surface.uvs!], [0, 0, 1, 0, 0, 1]);
  assert.deepEqual([...surface.texture!.bytes], [1, 2, 3]);
  assert.throws(() => readGlb(new Uint8Array(40)), /not a binary glTF/);
  assert.throws(() => readGlb(glbOf().subarray(0, 200)), /truncated/);
  assert.throws(() => readGlb(glbOf((json) => (json['meshes'] = []))), /no surface/);
  const more = (json: Record<string, unknown>) => ((json['accessors'] as { count: number }[])[0]!.count = 4);
  assert.throws(() => readGlb(glbOf(more)), /truncated/);
  const fewer = (json: Record<string, unknown>) => ((json['accessors'] as { count: number }[])[0]!.count = 2);
  assert.throws(() => readGlb(glbOf(fewer)), /missing vertices/);
});

test('a click hits the nearest surface within the box', () => {
  const two = new Float32Array([0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, -1, 2, 0, -1, 0, 2, -1]);
  const both = Uint32Array.from([3, 4, 5, 0, 2, 1]);
  assert.deepEqual(hitOf(two, both, [0.5, 0.5, 5], [0, 0, -2]), [0.5, 0.5, 0], 'from either side');
  assert.deepEqual(
    hitOf(two, both, [0.5, 0.5, 5], [0, 0, -2], (_x, _y, z) => z < -0.5),
    [0.5, 0.5, -1],
  );
  assert.equal(hitOf(two, both, [1.5, 1.5, 5], [0, 0, -1]), null, 'beside it');
  assert.equal(hitOf(two, both, [0.5, 0.5, 5], [0, 0, 1]), null, 'behind the eye');
});

test('large clouds are subsampled', () => {
  const ply =
    'ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nend_header\n';
  const bytes = new TextEncoder().encode(ply + [0, 1, 2, 3, 4].map((n) => `${n} 0 0`).join('\n') + '\n');
  assert.deepEqual([...readPly(bytes, 3).positions], [0, 0, 0, 2, 0, 0, 4, 0, 0]);
  assert.equal(readPly(bytes, 5).count, 5);
});
