// A model as the page uses it, read in a worker so that the page stays quick.
import {
  centreOf,
  parseCameras,
  parseImages,
  parsePoints,
  rotationOf,
  type Camera,
  type Cloud,
  type PosedImage,
} from './colmap';

export interface Model {
  cameras: Map<number, Camera>;
  images: Map<number, PosedImage>;
  cloud: Cloud;
  skipped: number;
}

export function modelOf(cameras: string, images: string, points: string): Model {
  const c = parseCameras(cameras);
  const i = parseImages(images);
  const p = parsePoints(points);
  return {
    cameras: c.value,
    images: i.value,
    cloud: p.value,
    skipped: c.skipped + i.skipped + p.skipped,
  };
}

// Upwards, as most of the cameras were held.
export function upOf(images: Iterable<PosedImage>): [number, number, number] {
  const sum: [number, number, number] = [0, 0, 0];
  for (const image of images) {
    const r = rotationOf(image.q);
    for (let i = 0; i < 3; i++) sum[i]! -= r[3 + i]!;
  }
  return sum;
}

// Lines of the frusta, pairs of points: from each camera to the corners of its image, and around.
export function frusta(model: Model, size: number): { lines: Float32Array; names: string[] } {
  const all: number[] = [];
  const names: string[] = [];
  for (const image of model.images.values()) {
    const camera = model.cameras.get(image.camera);
    const focal = camera?.params[0] ?? 1;
    const w = camera ? (0.5 * camera.width) / focal : 0.5;
    const h = camera ? (0.5 * camera.height) / focal : 0.4;
    const r = rotationOf(image.q);
    const c = centreOf(image);
    const at = (x: number, y: number) =>
      [0, 1, 2].map((i) => c[i]! + size * (r[i]! * x + r[3 + i]! * y + r[6 + i]!));
    const corners = [at(-w, -h), at(w, -h), at(w, h), at(-w, h)];
    corners.forEach((corner, i) => {
      all.push(...c, ...corner, ...corner, ...corners[(i + 1) % 4]!);
    });
    // A mark at the upper edge, so that up and down differ.
    all.push(...at(-0.3 * w, -h), ...at(0, -1.35 * h), ...at(0, -1.35 * h), ...at(0.3 * w, -h));
    names.push(image.name);
  }
  return { lines: new Float32Array(all), names };
}

export function boxText(positions: Float32Array): string {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    const v = positions[i]!;
    if (v < low[i % 3]!) low[i % 3] = v;
    if (v > high[i % 3]!) high[i % 3] = v;
  }
  return low.map((l, i) => (high[i]! - l).toPrecision(3)).join(' x ');
}
