// SPDX-License-Identifier: MIT
// node face_points.mjs PACKAGE normal|tiny IMAGE.ppm ..
// Runs the 68 points of the npm package @vladmandic/face-api, which lies in the folder PACKAGE, on images (binary PPM): the
// network tiny_face_detector finds the face, as the package does it for points, and face_landmark_68 (normal) or
// face_landmark_68_tiny (tiny) its points. Prints for each image a line {"image", "faces": [{"box": [x, y, w, h], "points":
// [[x, y] ..], "score"}], "ms", "fit_ms"}: of all faces the one of the highest score. Times are processor time: of all, and of the points alone.
import { cpuMs, loadPackage, loadWeights, readPixels, stdout, words } from './face_api.mjs';

const { folder, images: [size, ...images] } = words('node face_points.mjs PACKAGE normal|tiny IMAGE.ppm ..');
if (size !== 'normal' && size !== 'tiny') throw new Error(`${size}: normal or tiny was expected`);
const faceapi = await loadPackage(folder);
const detector = loadWeights(faceapi, folder, 'tiny_face_detector_model', new faceapi.TinyFaceDetector());
const net = size === 'tiny' ?
  loadWeights(faceapi, folder, 'face_landmark_68_tiny_model', new faceapi.FaceLandmark68TinyNet()) :
  loadWeights(faceapi, folder, 'face_landmark_68_model', new faceapi.FaceLandmark68Net());
const options = new faceapi.TinyFaceDetectorOptions({ inputSize: 416, scoreThreshold: 0.1 });
for (const image of images) {
  const { pixels } = readPixels(faceapi, image);
  const begin = cpuMs();
  const [best] = (await detector.locateFaces(pixels, options)).sort((a, b) => b.score - a.score);
  const found = cpuMs();
  const faces = [];
  if (best) {
    const [face] = await faceapi.extractFaceTensors(pixels, [best]);
    const marks = (await net.detectLandmarks(face)).shiftBy(best.box.x, best.box.y);
    const { x, y, width, height } = best.box;
    faces.push({ box: [x, y, width, height], points: marks.positions.map((point) => [point.x, point.y]), score: best.score });
    face.dispose();
  }
  pixels.dispose();
  stdout.write(`${JSON.stringify({ image, faces, ms: cpuMs() - begin, fit_ms: cpuMs() - found })}\n`);
}
