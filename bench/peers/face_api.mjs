// SPDX-License-Identifier: MIT
// The networks of the npm package @vladmandic/face-api in plain JavaScript, for the peers of this folder.
import { readFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

export const { stdout } = process;
const { cpuUsage } = process;

// Processor time of this program so far, ms: of all its threads.
export function cpuMs() {
  const { user, system } = cpuUsage();
  return (user + system) / 1000;
}

// PACKAGE and the images of the command line `node script PACKAGE IMAGE ..`.
export function words(usage) {
  const [folder, ...images] = process.argv.slice(2);
  if (!folder || images.length === 0) {
    console.error(`usage: ${usage}`);
    process.exit(2);
  }
  return { folder, images };
}

// The package of that folder, ready to compute. Afterwards there is no `process`: the bundle is made for browsers, and where
// it sees Node it asks for packages that it does not carry.
export async function loadPackage(folder) {
  globalThis.process = undefined;
  const faceapi = await import(pathToFileURL(join(resolve(folder), 'dist/face-api.esm.js')).href);
  const tf = faceapi.tf;
  tf.env().setPlatform('plain', {
    fetch: () => Promise.reject(new Error('nothing is fetched')),
    now: () => performance.now(),
    encode: (text) => new TextEncoder().encode(text),
    decode: (bytes) => new TextDecoder().decode(bytes),
    isTypedArray: (value) => ArrayBuffer.isView(value) && !(value instanceof DataView),
    setTimeoutCustom: (run, ms) => setTimeout(run, ms),
  });
  await tf.setBackend('cpu');
  await tf.ready();
  // Outside a browser there are no canvases; the networks ask for their classes only to tell tensors from them.
  class Nothing {}
  faceapi.env.setEnv({
    Canvas: Nothing, CanvasRenderingContext2D: Nothing, Image: Nothing, ImageData: Nothing, Video: Nothing,
    createCanvasElement: () => new Nothing(), createImageElement: () => new Nothing(),
    createVideoElement: () => new Nothing(), fetch: () => Promise.reject(new Error('nothing is fetched')),
    readFile: () => Promise.reject(new Error('nothing is read')),
  });
  return faceapi;
}

// Gives a network the weights of model/NAME of the package.
export function loadWeights(faceapi, folder, name, net) {
  const model = join(resolve(folder), 'model', name);
  const specs = JSON.parse(readFileSync(`${model}-weights_manifest.json`, 'utf8')).flatMap((group) => group.weights);
  const bytes = readFileSync(`${model}.bin`);
  net.loadFromWeightMap(faceapi.tf.io.decodeWeights(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), specs));
  return net;
}

// A binary PPM of 8 bits: its size, and a tensor height x width x 3.
export function readPixels(faceapi, path) {
  const file = readFileSync(path);
  const header = /^P6\s+(\d+)\s+(\d+)\s+255\s/.exec(file.subarray(0, 40).toString('latin1'));
  if (!header) throw new Error(`${path}: not a PPM of 8 bits`);
  const [width, height] = [Number(header[1]), Number(header[2])];
  const pixels = faceapi.tf.tensor3d(new Uint8Array(file.subarray(header[0].length)), [height, width, 3], 'int32');
  return { width, height, pixels };
}
