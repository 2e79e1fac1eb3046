// Where the viewer of a cloud stands: around a target, by angles and distance. Pure.

export type Vector = [number, number, number];

export interface Orbit {
  target: Vector;
  distance: number;
  yaw: number; // radians, around the upward axis
  pitch: number; // radians, above the horizon
}

const steepest = Math.PI / 2 - 0.02;

export function eyeOf(orbit: Orbit): Vector {
  const [x, y, z] = orbit.target;
  const across = orbit.distance * Math.cos(orbit.pitch);
  return [
    x + across * Math.sin(orbit.yaw),
    y + orbit.distance * Math.sin(orbit.pitch),
    z + across * Math.cos(orbit.yaw),
  ];
}

export function turned(orbit: Orbit, yaw: number, pitch: number): Orbit {
  return {
    ...orbit,
    yaw: orbit.yaw + yaw,
    pitch: Math.min(steepest, Math.max(-steepest, orbit.pitch + pitch)),
  };
}

export function nearer(orbit: Orbit, factor: number, radius: number): Orbit {
  const distance = Math.min(50 * radius, Math.max(radius / 500, orbit.distance * factor));
  return { ...orbit, distance };
}

// Moves the target by shares of the view's height: right and up as seen.
export function moved(orbit: Orbit, right: number, up: number, fieldOfView: number): Orbit {
  const size = 2 * orbit.distance * Math.tan(fieldOfView / 2);
  const sideways: Vector = [Math.cos(orbit.yaw), 0, -Math.sin(orbit.yaw)];
  const upwards: Vector = [
    -Math.sin(orbit.pitch) * Math.sin(orbit.yaw),
    Math.cos(orbit.pitch),
    -Math.sin(orbit.pitch) * Math.cos(orbit.yaw),
  ];
  const target = orbit.target.map((v, i) => v + size * (right * sideways[i]! + up * upwards[i]!)) as Vector;
  return { ...orbit, target };
}

// What a key does to the view; null where it is no key of the viewer.
export function keyed(
  orbit: Orbit,
  key: string,
  shift: boolean,
  radius: number,
  fieldOfView: number,
): Orbit | null {
  const turn = Math.PI / 24;
  const step = 0.06;
  const by: Record<string, Orbit> = shift
    ? {
        ArrowLeft: moved(orbit, -step, 0, fieldOfView),
        ArrowRight: moved(orbit, step, 0, fieldOfView),
        ArrowUp: moved(orbit, 0, step, fieldOfView),
        ArrowDown: moved(orbit, 0, -step, fieldOfView),
        '+': nearer(orbit, 0.8, radius),
      }
    : {
        ArrowLeft: turned(orbit, -turn, 0),
        ArrowRight: turned(orbit, turn, 0),
        ArrowUp: turned(orbit, 0, turn),
        ArrowDown: turned(orbit, 0, -turn),
        '+': nearer(orbit, 0.8, radius),
        '=': nearer(orbit, 0.8, radius),
        '-': nearer(orbit, 1.25, radius),
      };
  return by[key] ?? null;
}

// The rotation, row by row, that takes `up` to the y axis.
export function upright(up: Vector): number[] {
  const length = Math.hypot(...up);
  if (length < 1e-9) return [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const y = up.map((v) => v / length) as Vector;
  const helper: Vector = Math.abs(y[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1];
  const dot = helper[0] * y[0] + helper[1] * y[1] + helper[2] * y[2];
  let x = helper.map((v, i) => v - dot * y[i]!) as Vector;
  const size = Math.hypot(...x);
  x = x.map((v) => v / size) as Vector;
  const z: Vector = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
  return [...x, ...y, ...z];
}

export function rotate(r: readonly number[], [x, y, z]: Vector): Vector {
  return [
    r[0]! * x + r[1]! * y + r[2]! * z,
    r[3]! * x + r[4]! * y + r[5]! * z,
    r[6]! * x + r[7]! * y + r[8]! * z,
  ];
}

// The number of the point that a click at (x, y) means: of those within `reach` px the nearest to the eye.
// `matrix` takes a point to clip space (column by column, as WebGL has it); points for which `keep` is false are
// passed over. -1: none.
export function pick(
  positions: Float32Array,
  matrix: readonly number[],
  width: number,
  height: number,
  x: number,
  y: number,
  reach: number,
  keep: (index: number) => boolean = () => true,
): number {
  let best = -1;
  let bestScore = Infinity;
  const m = matrix;
  for (let i = 0; i < positions.length / 3; i++) {
    const px = positions[3 * i]!;
    const py = positions[3 * i + 1]!;
    const pz = positions[3 * i + 2]!;
    const w = m[3]! * px + m[7]! * py + m[11]! * pz + m[15]!;
    if (w <= 0) continue;
    const sx = ((m[0]! * px + m[4]! * py + m[8]! * pz + m[12]!) / w + 1) * 0.5 * width;
    const sy = (1 - (m[1]! * px + m[5]! * py + m[9]! * pz + m[13]!) / w) * 0.5 * height;
    const away = Math.hypot(sx - x, sy - y);
    if (away > reach) continue;
    // A pixel off counts as a hundredth of the distance: near points before far ones.
    const score = w * (1 + 0.01 * away);
    if (score < bestScore && keep(i)) {
      bestScore = score;
      best = i;
    }
  }
  return best;
}

// A length for people: with a scale in its unit, else in units of the model.
export function lengthText(length: number, scale: number | null, unit: string): string {
  if (scale === null) return `${length.toPrecision(4)} units of the model`;
  return `${(length * scale).toPrecision(4)} ${unit}`;
}
