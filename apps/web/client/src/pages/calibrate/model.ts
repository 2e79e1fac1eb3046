// What the Calibrate page knows of the program's lines: pure.

export interface CameraLine {
  camera: string;
  model: string;
  board: string;
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  distortion: number[];
  rms: number;
  deviations: { fx: number; fy: number; cx: number; cy: number; distortion: number[] };
  images: number;
  used: number;
  coverage: number;
  missing: string[];
  warnings: string[];
}

export const boards: readonly { value: string; label: string }[] = [
  { value: 'chess:9x6', label: 'Chessboard, 9 x 6 inner corners' },
  { value: 'chess:7x5', label: 'Chessboard, 7 x 5 inner corners' },
  { value: 'charuco:5x7:6x6_250', label: 'ChArUco board, 5 x 7 (may be partly visible)' },
  { value: 'circles:4x11', label: 'Asymmetric circle grid, 4 x 11' },
  { value: 'circles-grid:7x6', label: 'Symmetric circle grid, 7 x 6' },
];

// Rows for people: value and how sure it is.
export function cameraRows(line: CameraLine): { name: string; value: string; deviation: string }[] {
  const row = (name: string, value: number, deviation: number | undefined, digits: number) => ({
    name,
    value: value.toFixed(digits),
    deviation: deviation === undefined ? '' : `± ${deviation.toFixed(digits)}`,
  });
  const names =
    line.model === 'fisheye' ? ['k1', 'k2', 'k3', 'k4'] : ['k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6'];
  return [
    row('Focal length x, px', line.fx, line.deviations?.fx, 2),
    row('Focal length y, px', line.fy, line.deviations?.fy, 2),
    row('Principal point x, px', line.cx, line.deviations?.cx, 2),
    row('Principal point y, px', line.cy, line.deviations?.cy, 2),
    ...line.distortion.map((value, i) =>
      row(`Distortion ${names[i] ?? i + 1}`, value, line.deviations?.distortion?.[i], 5),
    ),
  ];
}

export interface View {
  image: string;
  used: boolean;
  found: boolean;
  points: number;
  rms: number;
  tilt: number;
  reason: string;
}

// A view of a row of the table that `calibrate --csv` writes.
export function viewOf(row: Record<string, string>): View {
  return {
    image: row.image ?? '',
    used: row.used === '1',
    found: row.found === '1',
    points: Number(row.points) || 0,
    rms: Number(row.rms_px) || 0,
    tilt: Number(row.tilt_deg) || 0,
    reason: row.reason ?? '',
  };
}

// A length like 25 mm, as the program takes it; a problem otherwise.
export function squareProblem(text: string): string {
  const value = Number(text);
  if (!(value >= 1 && value <= 1000)) return 'Enter a value from 1 to 1000 mm.';
  return '';
}

export function perViewOf(value: unknown): { rms: number; tilt: number; points: number }[] {
  if (!Array.isArray(value)) return [];
  return value.map((one) => {
    const v = (typeof one === 'object' && one !== null ? one : {}) as Record<string, unknown>;
    const n = (name: string) => (typeof v[name] === 'number' ? (v[name] as number) : 0);
    return { rms: n('rms'), tilt: n('tilt'), points: n('points') };
  });
}
