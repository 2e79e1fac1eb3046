// Reads a surface of triangles from a .glb file (binary glTF 2.0), as `tarsier sfm mesh` writes it: one mesh, its
// texture or the colours of its vertices. The matrix of the node is left out, so that the surface lies where the model
// does. Pure.
import type { Cloud } from './colmap';
import { cloudOf } from './ply';

export interface Surface {
  cloud: Cloud; // the vertices
  faces: Uint32Array; // three numbers of vertices each
  uvs: Float32Array | null; // of each vertex, from the upper left corner of the texture
  texture: { type: string; bytes: Uint8Array<ArrayBuffer> } | null;
}

interface Accessor {
  bufferView?: number;
  byteOffset?: number;
  componentType: number;
  count: number;
  type: string;
}

interface View {
  byteOffset?: number;
  byteLength: number;
  byteStride?: number;
}

interface Gltf {
  accessors?: Accessor[];
  bufferViews?: View[];
  images?: { bufferView?: number; mimeType?: string }[];
  meshes?: { primitives: { attributes: Record<string, number>; indices?: number; mode?: number }[] }[];
}

const magic = 0x46546c67;
const jsonChunk = 0x4e4f534a;
const binaryChunk = 0x004e4942;
const widths: Record<string, number> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const readers: Record<number, [bytes: number, read: (view: DataView, at: number) => number]> = {
  5121: [1, (view, at) => view.getUint8(at)],
  5123: [2, (view, at) => view.getUint16(at, true)],
  5125: [4, (view, at) => view.getUint32(at, true)],
  5126: [4, (view, at) => view.getFloat32(at, true)],
};

/** Throws an Error with a plain line. */
export function readGlb(file: Uint8Array): Surface {
  const head = new DataView(file.buffer, file.byteOffset, file.byteLength);
  if (file.length < 20 || head.getUint32(0, true) !== magic || head.getUint32(4, true) !== 2)
    throw new Error('This is not a binary glTF file.');
  let json: Gltf | undefined;
  let binary = new Uint8Array(0);
  for (let at = 12; at + 8 <= file.length;) {
    const length = head.getUint32(at, true);
    const kind = head.getUint32(at + 4, true);
    if (at + 8 + length > file.length) throw new Error('This glTF file is truncated.');
    const chunk = file.slice(at + 8, at + 8 + length);
    if (kind === jsonChunk) json = JSON.parse(new TextDecoder().decode(chunk)) as Gltf;
    if (kind === binaryChunk) binary = chunk;
    at += 8 + length;
  }
  const part = json?.meshes?.[0]?.primitives[0];
  if (!json || !part || part.indices === undefined || (part.mode ?? 4) !== 4)
    throw new Error('This glTF file has no surface of triangles.');
  const positions = numbers(json, binary, part.attributes['POSITION'], 3, Float32Array);
  const faces = numbers(json, binary, part.indices, 1, Uint32Array);
  if (!positions || !faces) throw new Error('This glTF file has no surface of triangles.');
  const count = positions.length / 3;
  if (faces.some((vertex) => vertex >= count)) throw new Error('This glTF file refers to missing vertices.');
  const uvs = numbers(json, binary, part.attributes['TEXCOORD_0'], 2, Float32Array);
  const linear = numbers(json, binary, part.attributes['COLOR_0'], 4, Uint8Array);
  const colours = new Uint8Array(3 * count).fill(180);
  if (linear)
    for (let i = 0; i < count; i++)
      for (let c = 0; c < 3; c++) colours[3 * i + c] = srgb[linear[4 * i + c]!]!;
  return { cloud: cloudOf(positions, colours), faces, uvs, texture: uvs && textureOf(json, binary) };
}

// glTF's colours of vertices are linear.
const srgb = Uint8Array.from({ length: 256 }, (_, i) => {
  const v = i / 255;
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
});

function bytesOf(json: Gltf, binary: Uint8Array<ArrayBuffer>, index: number | undefined): DataView | null {
  const view = index === undefined ? undefined : json.bufferViews?.[index];
  if (!view) return null;
  const offset = view.byteOffset ?? 0;
  if (offset + view.byteLength > binary.length) throw new Error('This glTF file is truncated.');
  return new DataView(binary.buffer, binary.byteOffset + offset, view.byteLength);
}

function numbers<T extends Float32Array | Uint32Array | Uint8Array>(
  json: Gltf,
  binary: Uint8Array<ArrayBuffer>,
  index: number | undefined,
  width: number,
  Kind: new (length: number) => T,
): T | null {
  const accessor = index === undefined ? undefined : json.accessors?.[index];
  const bytes = bytesOf(json, binary, accessor?.bufferView);
  const reader = accessor && readers[accessor.componentType];
  if (!accessor || !bytes || !reader || widths[accessor.type] !== width) return null;
  const [size, read] = reader;
  const stride = json.bufferViews![accessor.bufferView!]!.byteStride ?? size * width;
  const start = accessor.byteOffset ?? 0;
  if (accessor.count > 0 && start + stride * (accessor.count - 1) + size * width > bytes.byteLength)
    throw new Error('This glTF file is truncated.');
  const result = new Kind(accessor.count * width);
  for (let i = 0; i < accessor.count; i++)
    for (let k = 0; k < width; k++) result[width * i + k] = read(bytes, start + stride * i + size * k);
  return result;
}

function textureOf(json: Gltf, binary: Uint8Array<ArrayBuffer>): Surface['texture'] {
  const image = json.images?.[0];
  const bytes = bytesOf(json, binary, image?.bufferView);
  if (!image || !bytes) return null;
  const copy = new Uint8Array(bytes.byteLength);
  copy.set(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength));
  return { type: image.mimeType ?? 'image/jpeg', bytes: copy };
}

/** Where a ray first meets the surface: the point, or null. `positions` are those of the vertices, `keep` says which
 * points count. Moeller and Trumbore 1997. */
export function hitOf(
  positions: Float32Array,
  faces: Uint32Array,
  eye: readonly number[],
  ray: readonly number[],
  keep: (x: number, y: number, z: number) => boolean = () => true,
): [number, number, number] | null {
  let nearest = Infinity;
  let best: [number, number, number] | null = null;
  const [ex, ey, ez] = [eye[0]!, eye[1]!, eye[2]!];
  const [dx, dy, dz] = [ray[0]!, ray[1]!, ray[2]!];
  for (let f = 0; f + 2 < faces.length; f += 3) {
    const a = 3 * faces[f]!;
    const b = 3 * faces[f + 1]!;
    const c = 3 * faces[f + 2]!;
    const ax = positions[a]!;
    const ay = positions[a + 1]!;
    const az = positions[a + 2]!;
    const ux = positions[b]! - ax;
    const uy = positions[b + 1]! - ay;
    const uz = positions[b + 2]! - az;
    const vx = positions[c]! - ax;
    const vy = positions[c + 1]! - ay;
    const vz = positions[c + 2]! - az;
    const px = dy * vz - dz * vy;
    const py = dz * vx - dx * vz;
    const pz = dx * vy - dy * vx;
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const tx = ex - ax;
    const ty = ey - ay;
    const tz = ez - az;
    const s = (tx * px + ty * py + tz * pz) / det;
    if (!(s >= 0 && s <= 1)) continue;
    const qx = ty * uz - tz * uy;
    const qy = tz * ux - tx * uz;
    const qz = tx * uy - ty * ux;
    const t = (dx * qx + dy * qy + dz * qz) / det;
    if (!(t >= 0 && s + t <= 1)) continue;
    const away = (vx * qx + vy * qy + vz * qz) / det;
    if (!(away > 0 && away < nearest)) continue;
    const at: [number, number, number] = [ex + away * dx, ey + away * dy, ez + away * dz];
    if (!keep(...at)) continue;
    nearest = away;
    best = at;
  }
  return best;
}
