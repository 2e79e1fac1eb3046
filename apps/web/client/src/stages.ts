// The images of a frame's stages, as the server sends them. Pure.

export interface Stage {
  name: string;
  width: number;
  height: number;
  jpeg: Uint8Array;
}

export interface Stages {
  frame: number;
  list: Stage[];
}

// u32 big-endian frame, u32 length of the list, the list as JSON [{name,width,height,bytes}], the JPEGs one behind the
// other. Throws on anything else.
export function parseStages(bytes: Uint8Array): Stages {
  const broken = () => new Error('The images of the stages are damaged.');
  if (bytes.length < 8) throw broken();
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = view.getUint32(4);
  if (8 + length > bytes.length) throw broken();
  const list = JSON.parse(new TextDecoder().decode(bytes.subarray(8, 8 + length))) as unknown;
  if (!Array.isArray(list)) throw broken();
  let at = 8 + length;
  const result: Stage[] = [];
  for (const one of list as { name?: unknown; width?: unknown; height?: unknown; bytes?: unknown }[]) {
    const { name, width, height, bytes: size } = one ?? {};
    if (typeof name !== 'string' || typeof width !== 'number' || typeof height !== 'number') throw broken();
    if (typeof size !== 'number' || !Number.isInteger(size) || size < 0 || at + size > bytes.length)
      throw broken();
    result.push({ name, width, height, jpeg: bytes.subarray(at, at + size) });
    at += size;
  }
  return { frame: view.getUint32(0), list: result };
}
