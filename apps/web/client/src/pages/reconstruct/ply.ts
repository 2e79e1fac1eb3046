// Reads and writes point clouds as PLY. Pure.
import type { Cloud } from './colmap';

const sizes: Record<string, number> = {
  char: 1,
  uchar: 1,
  int8: 1,
  uint8: 1,
  short: 2,
  ushort: 2,
  int16: 2,
  uint16: 2,
  int: 4,
  uint: 4,
  int32: 4,
  uint32: 4,
  float: 4,
  float32: 4,
  double: 8,
  float64: 8,
};
const maxHeader = 64 * 1024;

/** Points without tracks, numbered as they come. */
export function cloudOf(positions: Float32Array, colours: Uint8Array): Cloud {
  const count = positions.length / 3;
  return {
    count,
    positions,
    colours,
    ids: Uint32Array.from({ length: count }, (_, i) => i),
    errors: new Float32Array(count),
    trackStart: new Uint32Array(count + 1),
    tracks: new Uint32Array(0),
  };
}

/** The vertices of a PLY, ascii or binary little endian; of more than `most` every second, or third .. one. Throws an
 * Error with a plain line. */
export function readPly(bytes: Uint8Array, most = Infinity): Cloud {
  const head = new TextDecoder('latin1').decode(bytes.subarray(0, Math.min(bytes.length, maxHeader)));
  const end = /end_header\r?\n/.exec(head);
  if (!head.startsWith('ply') || !end) throw new Error('This is not a PLY file.');
  let format = '';
  let count = 0;
  let isVertex = false;
  let seenOther = false;
  const properties: { name: string; type: string }[] = [];
  for (const line of head.slice(0, end.index).split(/\r?\n/)) {
    const words = line.trim().split(/\s+/);
    if (words[0] === 'format') format = words[1] ?? '';
    if (words[0] === 'element') {
      isVertex = words[1] === 'vertex';
      if (isVertex && seenOther) throw new Error('The vertices are not the first element of this PLY file.');
      if (isVertex) count = Number(words[2]);
      else seenOther = true;
    }
    if (words[0] === 'property' && isVertex) {
      if (words[1] === 'list') throw new Error('The vertices of this PLY file have list properties.');
      properties.push({ type: words[1] ?? '', name: words[2] ?? '' });
    }
  }
  const place = new Map<string, { offset: number; index: number; type: string }>();
  let stride = 0;
  properties.forEach((p, index) => {
    const size = sizes[p.type];
    if (!size) throw new Error('This PLY file has a property of an unknown type.');
    place.set(p.name, { offset: stride, index, type: p.type });
    stride += size;
  });
  if (!['x', 'y', 'z'].every((name) => place.has(name))) throw new Error('This PLY file has no x, y, z.');
  if (!Number.isInteger(count) || count < 0)
    throw new Error('This PLY file does not give the number of points.');
  const start = end.index + end[0].length;
  let read: (i: number, name: string) => number;
  if (format === 'binary_little_endian') {
    if (bytes.length - start < count * stride) throw new Error('This PLY file is truncated.');
    const view = new DataView(bytes.buffer, bytes.byteOffset + start);
    read = (i, name) => {
      const p = place.get(name);
      return p ? numberAt(view, i * stride + p.offset, p.type) : 255;
    };
  } else if (format === 'ascii') {
    const rows = new TextDecoder().decode(bytes.subarray(start)).split('\n');
    if (rows.length < count) throw new Error('This PLY file is truncated.');
    const cut = rows.slice(0, count).map((row) => row.trim().split(/\s+/).map(Number));
    read = (i, name) => {
      const p = place.get(name);
      return p ? (cut[i]![p.index] ?? 0) : 255;
    };
  } else {
    throw new Error('This PLY file is neither ascii nor binary little endian.');
  }
  const step = Math.max(1, Math.ceil(count / most));
  const kept = Math.ceil(count / step);
  const positions = new Float32Array(3 * kept);
  const colours = new Uint8Array(3 * kept);
  ['x', 'y', 'z'].forEach((name, axis) => {
    for (let n = 0; n < kept; n++) positions[3 * n + axis] = read(n * step, name);
  });
  ['red', 'green', 'blue'].forEach((name, channel) => {
    for (let n = 0; n < kept; n++) colours[3 * n + channel] = read(n * step, name);
  });
  return cloudOf(positions, colours);
}

function numberAt(view: DataView, at: number, type: string): number {
  switch (type) {
    case 'char':
    case 'int8':
      return view.getInt8(at);
    case 'uchar':
    case 'uint8':
      return view.getUint8(at);
    case 'short':
    case 'int16':
      return view.getInt16(at, true);
    case 'ushort':
    case 'uint16':
      return view.getUint16(at, true);
    case 'int':
    case 'int32':
      return view.getInt32(at, true);
    case 'uint':
    case 'uint32':
      return view.getUint32(at, true);
    case 'double':
    case 'float64':
      return view.getFloat64(at, true);
    default:
      return view.getFloat32(at, true);
  }
}

/** A binary PLY of the points for which `keep` is true; `scale` multiplies the positions. */
export function writePly(cloud: Cloud, keep: (i: number) => boolean = () => true, scale = 1): Uint8Array {
  const chosen: number[] = [];
  for (let i = 0; i < cloud.count; i++) if (keep(i)) chosen.push(i);
  const head = new TextEncoder().encode(
    [
      'ply',
      'format binary_little_endian 1.0',
      `element vertex ${chosen.length}`,
      'property float x',
      'property float y',
      'property float z',
      'property uchar red',
      'property uchar green',
      'property uchar blue',
      'end_header',
      '',
    ].join('\n'),
  );
  const bytes = new Uint8Array(head.length + 15 * chosen.length);
  bytes.set(head);
  const view = new DataView(bytes.buffer, head.length);
  chosen.forEach((i, n) => {
    for (let c = 0; c < 3; c++) {
      view.setFloat32(15 * n + 4 * c, scale * cloud.positions[3 * i + c]!, true);
      view.setUint8(15 * n + 12 + c, cloud.colours[3 * i + c]!);
    }
  });
  return bytes;
}
