// SPDX-License-Identifier: MIT
// node face_embedding.mjs PACKAGE CHIP.ppm ..
// Runs the face recognition network of the npm package @vladmandic/face-api, which lies in the folder PACKAGE, in plain
// JavaScript on images of 150 x 150 px (binary PPM), and prints for each a line {"image", "embedding": [128 numbers]}.
import { readFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

const [folder, ...images] = process.argv.slice(2);
if (!folder || images.length === 0) {
  console.error('usage: node face_embedding.mjs PACKAGE CHIP.ppm ..');
  process.exit(2);
}
// The bundle is made for browsers: where it sees Node it asks for packages that it does not carry.
const { stdout } = process;
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
// Outside a browser there are no canvases; the network asks for their classes only to tell tensors from them.
class Nothing {}
faceapi.env.setEnv({
  Canvas: Nothing, CanvasRenderingContext2D: Nothing, Image: Nothing, ImageData: Nothing, Video: Nothing,
  createCanvasElement: () => new Nothing(), createImageElement: () => new Nothing(),
  createVideoElement: () => new Nothing(), fetch: () => Promise.reject(new Error('nothing is fetched')),
  readFile: () => Promise.reject(new Error('nothing is read')),
});

const model = join(resolve(folder), 'model/face_recognition_model');
const specs = JSON.parse(readFileSync(`${model}-weights_manifest.json`, 'utf8')).flatMap((group) => group.weights);
const bytes = readFileSync(`${model}.bin`);
const weights = tf.io.decodeWeights(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), specs);
const net = new faceapi.FaceRecognitionNet();
net.loadFromWeightMap(weights);

for (const image of images) {
  const file = readFileSync(image);
  const header = /^P6\s+(\d+)\s+(\d+)\s+255\s/.exec(file.subarray(0, 40).toString('latin1'));
  if (!header || header[1] !== '150' || header[2] !== '150') throw new Error(`${image}: not a PPM of 150 x 150 px`);
  const pixels = tf.tensor3d(new Uint8Array(file.subarray(header[0].length)), [150, 150, 3], 'int32');
  const embedding = await net.computeFaceDescriptor(pixels);
  stdout.write(`${JSON.stringify({ image, embedding: Array.from(embedding) })}\n`);
}
