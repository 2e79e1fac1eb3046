// Reads COLMAP's text model: cameras.txt, images.txt, points3D.txt. Pure: no DOM, no network.
// Lines that do not fit the format are counted and left out; nothing throws on bad text.

export interface Camera {
  id: number;
  model: string;
  width: number;
  height: number;
  params: number[];
}

export interface PosedImage {
  id: number;
  name: string;
  camera: number;
  /** Quaternion w x y z and translation: a point of the world to the camera's frame. */
  q: [number, number, number, number];
  t: [number, number, number];
  /** x0 y0 x1 y1 .. of the features, COLMAP's pixels (the corner of the first is 0, 0). */
  xy: Float32Array;
}

export interface Cloud {
  count: number;
  ids: Uint32Array;
  /** x y z of each point. */
  positions: Float32Array;
  /** r g b, 0 to 255. */
  colours: Uint8Array;
  errors: Float32Array;
  /** Where the track of point i begins in `tracks`; count + 1 entries. */
  trackStart: Uint32Array;
  /** Pairs: number of the image, number of the feature in it. */
  tracks: Uint32Array;
}

export interface Parsed<T> {
  value: T;
  skipped: number;
}

/** Calls `use` with each line that is no comment; the lines are cut one at a time. */
export function eachLine(text: string, use: (line: string) => void, keepEmpty = false): void {
  let start = 0;
  while (start < text.length) {
    let end = text.indexOf('\n', start);
    if (end < 0) end = text.length;
    let stop = end;
    if (stop > start && text.charCodeAt(stop - 1) === 13) stop--;
    if (text.charCodeAt(start) !== 35 && (keepEmpty || stop > start)) use(text.slice(start, stop));
    start = end + 1;
  }
}

export function parseCameras(text: string): Parsed<Map<number, Camera>> {
  const value = new Map<number, Camera>();
  let skipped = 0;
  eachLine(text, (line) => {
    const words = line.trim().split(/\s+/);
    const id = Number(words[0]);
    const width = Number(words[2]);
    const height = Number(words[3]);
    const params = words.slice(4).map(Number);
    const good =
      Number.isInteger(id) && width > 0 && height > 0 && params.length > 0 && params.every(Number.isFinite);
    if (!good) {
      skipped++;
      return;
    }
    value.set(id, { id, model: words[1] ?? '', width, height, params });
  });
  return { value, skipped };
}

export function parseImages(text: string): Parsed<Map<number, PosedImage>> {
  const value = new Map<number, PosedImage>();
  let skipped = 0;
  let head: string | null = null;
  eachLine(
    text,
    (line) => {
      if (head === null) {
        if (line.trim() !== '') head = line;
        return;
      }
      const image = imageOf(head, line);
      if (image) value.set(image.id, image);
      else skipped++;
      head = null;
    },
    true,
  );
  if (head !== null) {
    // The last image has no features, and no line for them.
    const image = imageOf(head, '');
    if (image) value.set(image.id, image);
    else skipped++;
  }
  return { value, skipped };
}

function imageOf(head: string, features: string): PosedImage | null {
  const words = head.trim().split(/\s+/);
  if (words.length < 10) return null;
  const n = words.slice(0, 9).map(Number);
  if (!n.every(Number.isFinite)) return null;
  const [id, qw, qx, qy, qz, tx, ty, tz, camera] = n as [
    number,
    number,
    number,
    number,
    number,
    number,
    number,
    number,
    number,
  ];
  const parts = features === '' ? [] : features.trim().split(/\s+/);
  const count = Math.floor(parts.length / 3);
  const xy = new Float32Array(2 * count);
  for (let i = 0; i < count; i++) {
    xy[2 * i] = Number(parts[3 * i]);
    xy[2 * i + 1] = Number(parts[3 * i + 1]);
  }
  // A name may hold spaces.
  const name = words.slice(9).join(' ');
  return { id, name, camera, q: [qw, qx, qy, qz], t: [tx, ty, tz], xy };
}

export function parsePoints(text: string): Parsed<Cloud> {
  let lines = 0;
  eachLine(text, () => lines++);
  const ids = new Uint32Array(lines);
  const positions = new Float32Array(3 * lines);
  const colours = new Uint8Array(3 * lines);
  const errors = new Float32Array(lines);
  const trackStart = new Uint32Array(lines + 1);
  let tracks = new Uint32Array(Math.max(64, 12 * lines));
  let used = 0;
  let count = 0;
  let skipped = 0;
  eachLine(text, (line) => {
    const words = line.trim().split(' ');
    const x = Number(words[1]);
    const y = Number(words[2]);
    const z = Number(words[3]);
    if (words.length < 8 || !Number.isFinite(x) || !Number.isFinite(y) || !Number.isFinite(z)) {
      skipped++;
      return;
    }
    ids[count] = Number(words[0]);
    positions[3 * count] = x;
    positions[3 * count + 1] = y;
    positions[3 * count + 2] = z;
    for (let c = 0; c < 3; c++) colours[3 * count + c] = Number(words[4 + c]);
    errors[count] = Number(words[7]);
    trackStart[count] = used;
    const pairs = Math.floor((words.length - 8) / 2);
    if (used + 2 * pairs > tracks.length) {
      const larger = new Uint32Array(2 * (used + 2 * pairs));
      larger.set(tracks);
      tracks = larger;
    }
    for (let i = 0; i < 2 * pairs; i++) tracks[used++] = Number(words[8 + i]);
    count++;
    trackStart[count] = used;
  });
  return {
    value: {
      count,
      ids: ids.slice(0, count),
      positions: positions.slice(0, 3 * count),
      colours: colours.slice(0, 3 * count),
      errors: errors.slice(0, count),
      trackStart: trackStart.slice(0, count + 1),
      tracks: tracks.slice(0, used),
    },
    skipped,
  };
}

/** The rotation of a unit quaternion w x y z, row by row. */
export function rotationOf(q: readonly [number, number, number, number]): number[] {
  const length = Math.hypot(...q) || 1;
  const [w, x, y, z] = q.map((v) => v / length) as [number, number, number, number];
  return [
    1 - 2 * (y * y + z * z),
    2 * (x * y - w * z),
    2 * (x * z + w * y),
    2 * (x * y + w * z),
    1 - 2 * (x * x + z * z),
    2 * (y * z - w * x),
    2 * (x * z - w * y),
    2 * (y * z + w * x),
    1 - 2 * (x * x + y * y),
  ];
}

/** Where the camera stood: -Rᵀ t. */
export function centreOf(image: PosedImage): [number, number, number] {
  const r = rotationOf(image.q);
  const [x, y, z] = image.t;
  const along = (c: number) => -(r[c]! * x + r[3 + c]! * y + r[6 + c]! * z);
  return [along(0), along(1), along(2)];
}

/** Focal lengths, centre, and what the lens adds, of COLMAP's models that the program writes. */
function lensOf(camera: Camera): { fx: number; fy: number; cx: number; cy: number; k: number[] } | null {
  const p = camera.params;
  const at = (i: number) => p[i] ?? 0;
  switch (camera.model) {
    case 'SIMPLE_PINHOLE':
      return { fx: at(0), fy: at(0), cx: at(1), cy: at(2), k: [] };
    case 'PINHOLE':
      return { fx: at(0), fy: at(1), cx: at(2), cy: at(3), k: [] };
    case 'SIMPLE_RADIAL':
      return { fx: at(0), fy: at(0), cx: at(1), cy: at(2), k: [at(3)] };
    case 'RADIAL':
      return { fx: at(0), fy: at(0), cx: at(1), cy: at(2), k: [at(3), at(4)] };
    case 'OPENCV':
    case 'FULL_OPENCV':
      return { fx: at(0), fy: at(1), cx: at(2), cy: at(3), k: p.slice(4) };
    default:
      return null;
  }
}

/** The pixel of a point of the world; null behind the camera or for a lens that is not known. */
export function project(
  camera: Camera,
  image: PosedImage,
  point: readonly [number, number, number],
): [number, number] | null {
  const lens = lensOf(camera);
  if (!lens) return null;
  const r = rotationOf(image.q);
  const [X, Y, Z] = point;
  const [tx, ty, tz] = image.t;
  const depth = r[6]! * X + r[7]! * Y + r[8]! * Z + tz;
  if (depth <= 1e-9) return null;
  const x = (r[0]! * X + r[1]! * Y + r[2]! * Z + tx) / depth;
  const y = (r[3]! * X + r[4]! * Y + r[5]! * Z + ty) / depth;
  const rr = x * x + y * y;
  const k = (i: number) => lens.k[i] ?? 0;
  const radial =
    (1 + k(0) * rr + k(1) * rr * rr + k(4) * rr * rr * rr) /
    (1 + k(5) * rr + k(6) * rr * rr + k(7) * rr * rr * rr);
  const u = x * radial + 2 * k(2) * x * y + k(3) * (rr + 2 * x * x);
  const v = y * radial + k(2) * (rr + 2 * y * y) + 2 * k(3) * x * y;
  return [lens.fx * u + lens.cx, lens.fy * v + lens.cy];
}

export interface Observation {
  image: PosedImage;
  seen: [number, number];
  projected: [number, number] | null;
  /** Distance of the two, px. */
  error: number | null;
}

/** Where the point with this place in the cloud was seen, largest error first. */
export function observationsOf(
  index: number,
  cloud: Cloud,
  images: ReadonlyMap<number, PosedImage>,
  cameras: ReadonlyMap<number, Camera>,
): Observation[] {
  const point: [number, number, number] = [
    cloud.positions[3 * index]!,
    cloud.positions[3 * index + 1]!,
    cloud.positions[3 * index + 2]!,
  ];
  const result: Observation[] = [];
  for (let i = cloud.trackStart[index]!; i + 1 < cloud.trackStart[index + 1]!; i += 2) {
    const image = images.get(cloud.tracks[i]!);
    const feature = cloud.tracks[i + 1]!;
    if (!image || 2 * feature + 1 >= image.xy.length) continue;
    const seen: [number, number] = [image.xy[2 * feature]!, image.xy[2 * feature + 1]!];
    const camera = cameras.get(image.camera);
    const projected = camera ? project(camera, image, point) : null;
    const error = projected ? Math.hypot(projected[0] - seen[0], projected[1] - seen[1]) : null;
    result.push({ image, seen, projected, error });
  }
  return result.sort((a, b) => (b.error ?? 0) - (a.error ?? 0));
}

export interface Bounds {
  centre: [number, number, number];
  radius: number;
}

/** Middle and size of the cloud without its farthest 2 % in each direction. */
export function boundsOf(positions: Float32Array): Bounds {
  const count = Math.floor(positions.length / 3);
  if (count === 0) return { centre: [0, 0, 0], radius: 1 };
  const step = Math.max(1, Math.floor(count / 20000));
  const low: number[] = [];
  const high: number[] = [];
  for (let axis = 0; axis < 3; axis++) {
    const values: number[] = [];
    for (let i = 0; i < count; i += step) values.push(positions[3 * i + axis]!);
    values.sort((a, b) => a - b);
    low.push(values[Math.floor(0.02 * (values.length - 1))]!);
    high.push(values[Math.ceil(0.98 * (values.length - 1))]!);
  }
  const centre = low.map((l, i) => (l + high[i]!) / 2) as [number, number, number];
  const radius = Math.max(1e-6, Math.hypot(...low.map((l, i) => high[i]! - l)) / 2);
  return { centre, radius };
}
