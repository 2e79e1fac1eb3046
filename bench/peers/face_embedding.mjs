// SPDX-License-Identifier: MIT
// node face_embedding.mjs PACKAGE CHIP.ppm ..
// Runs the face recognition network of the npm package @vladmandic/face-api, which lies in the folder PACKAGE, on images of
// 150 x 150 px (binary PPM), and prints for each a line {"image", "embedding": [128 numbers]}.
import { loadPackage, loadWeights, readPixels, stdout, words } from './face_api.mjs';

const { folder, images } = words('node face_embedding.mjs PACKAGE CHIP.ppm ..');
const faceapi = await loadPackage(folder);
const net = loadWeights(faceapi, folder, 'face_recognition_model', new faceapi.FaceRecognitionNet());
for (const image of images) {
  const { width, height, pixels } = readPixels(faceapi, image);
  if (width !== 150 || height !== 150) throw new Error(`${image}: not 150 x 150 px`);
  const embedding = await net.computeFaceDescriptor(pixels);
  stdout.write(`${JSON.stringify({ image, embedding: Array.from(embedding) })}\n`);
}
