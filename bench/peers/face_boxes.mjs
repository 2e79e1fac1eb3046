// SPDX-License-Identifier: MIT
// node face_boxes.mjs PACKAGE IMAGE.ppm ..
// Runs the network tiny_face_detector of the npm package @vladmandic/face-api, which lies in the folder PACKAGE, on images
// (binary PPM), and prints for each a line {"image", "faces": [{"score", "box": [x, y, w, h]}]}.
import { loadPackage, loadWeights, readPixels, stdout, words } from './face_api.mjs';

const { folder, images } = words('node face_boxes.mjs PACKAGE IMAGE.ppm ..');
const faceapi = await loadPackage(folder);
const net = loadWeights(faceapi, folder, 'tiny_face_detector_model', new faceapi.TinyFaceDetector());
const options = new faceapi.TinyFaceDetectorOptions({ inputSize: 416, scoreThreshold: 0.1 });
for (const image of images) {
  const found = await net.locateFaces(readPixels(faceapi, image).pixels, options);
  const faces = found.map(({ score, box }) => ({ score, box: [box.x, box.y, box.width, box.height] }));
  stdout.write(`${JSON.stringify({ image, faces })}\n`);
}
