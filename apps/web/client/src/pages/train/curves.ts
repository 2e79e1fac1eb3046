// Curves of a job: of the numbers that its verb prints, else of its progress. Pure.

export interface Series {
  name: string;
  x: number[];
  y: number[];
}

const axes = ['step', 'iteration', 'epoch', 'round', 'stage', 'level'];
const skipped = new Set(['seconds', 'ms', 'done', 'total', 'frame', 'time', 'version']);

/** A series for each number that at least three lines have; the x axis is the step, else the line. */
export function seriesOf(lines: readonly unknown[]): Series[] {
  const series = new Map<string, Series>();
  lines.forEach((line, n) => {
    if (typeof line !== 'object' || line === null || Array.isArray(line)) return;
    const record = line as Record<string, unknown>;
    const axis = axes.find((name) => typeof record[name] === 'number');
    const x = axis ? (record[axis] as number) : n;
    for (const [name, value] of Object.entries(record)) {
      if (typeof value !== 'number' || !Number.isFinite(value) || name === axis || skipped.has(name))
        continue;
      const found = series.get(name) ?? { name, x: [], y: [] };
      found.x.push(x);
      found.y.push(value);
      series.set(name, found);
    }
  });
  return [...series.values()].filter((s) => s.x.length >= 3);
}

export interface Sample {
  label: string;
  share: number;
  at: number;
}

/** Adds a progress to samples of the same job; equal neighbours are not repeated. */
export function addSample(samples: readonly Sample[], sample: Sample, most = 2000): Sample[] {
  const last = samples[samples.length - 1];
  if (last && last.label === sample.label && last.share === sample.share) return [...samples];
  return [...samples, sample].slice(-most);
}

/** Samples as one series a label, seconds since the first against share done. */
export function progressSeries(samples: readonly Sample[]): Series[] {
  const begin = samples[0]?.at ?? 0;
  const result = new Map<string, Series>();
  for (const s of samples) {
    const found = result.get(s.label) ?? { name: s.label, x: [], y: [] };
    found.x.push((s.at - begin) / 1000);
    found.y.push(100 * s.share);
    result.set(s.label, found);
  }
  return [...result.values()];
}

/** A polyline of a series in a box of w x h, with its ranges; y upwards. */
export function polyline(
  series: Series,
  w: number,
  h: number,
  low: number,
  high: number,
  x0: number,
  x1: number,
): string {
  const dx = x1 > x0 ? x1 - x0 : 1;
  const dy = high > low ? high - low : 1;
  return series.x
    .map((x, i) => `${round((w * (x - x0)) / dx)},${round(h - (h * (series.y[i]! - low)) / dy)}`)
    .join(' ');
}

function round(v: number): number {
  return Math.round(10 * v) / 10;
}

export interface Comparison {
  name: string;
  mine: number | null;
  shipped: number | null;
  /** Less is better, more is better, or neither is known. */
  better: 'mine' | 'shipped' | 'same' | null;
}

const lessIsBetter = /nme|error|failures|missed|wrong|mae|rotation_|beyond|eer|ms$|rms/;
const moreIsBetter = /auc|within|rate|right|found|answered|recall|precision|accuracy|exact/;

/** The numbers of two results, beside each other. */
export function compare(mine: unknown, shipped: unknown): Comparison[] {
  const a = numbersOf(mine);
  const b = numbersOf(shipped);
  const names = [...new Set([...a.keys(), ...b.keys()])];
  return names.map((name) => {
    const x = a.get(name) ?? null;
    const y = b.get(name) ?? null;
    let better: Comparison['better'] = null;
    if (x !== null && y !== null && x === y) better = 'same';
    else if (x !== null && y !== null && !/^(faces|images|set|limit|threads)/.test(name)) {
      if (moreIsBetter.test(name)) better = x > y ? 'mine' : 'shipped';
      else if (lessIsBetter.test(name)) better = x < y ? 'mine' : 'shipped';
    }
    return { name, mine: x, shipped: y, better };
  });
}

/** How a model did beside the one that ships, in one sentence; '' where nothing can be compared. */
export function comparisonText(rows: readonly Comparison[]): string {
  const compared = rows.filter((row) => row.better !== null);
  if (compared.length === 0) return '';
  const count = (which: Comparison['better']) => compared.filter((row) => row.better === which).length;
  const [mine, shipped, same] = [count('mine'), count('shipped'), count('same')];
  const equal = same > 0 ? `, equal in ${same}` : '';
  return `Of ${compared.length} figures the new model is better in ${mine}, the shipped model in ${shipped}${equal}.`;
}

function numbersOf(value: unknown, prefix = '', into = new Map<string, number>()): Map<string, number> {
  if (typeof value !== 'object' || value === null) return into;
  for (const [name, v] of Object.entries(value)) {
    if (typeof v === 'number' && Number.isFinite(v)) into.set(prefix + name, v);
    else if (typeof v === 'object' && v !== null && !Array.isArray(v) && prefix === '')
      numbersOf(v, `${name} `, into);
  }
  return into;
}

/** Rows of a CSV with a header, with quotes; at most `most` rows. */
export function parseCsv(text: string, most = 100000): Record<string, string>[] {
  const rows: string[][] = [];
  let row: string[] = [];
  let cell = '';
  let quoted = false;
  for (let i = 0; i < text.length && rows.length <= most; i++) {
    const c = text[i]!;
    if (quoted) {
      if (c === '"' && text[i + 1] === '"') {
        cell += '"';
        i++;
      } else if (c === '"') quoted = false;
      else cell += c;
    } else if (c === '"') quoted = true;
    else if (c === ',') {
      row.push(cell);
      cell = '';
    } else if (c === '\n') {
      row.push(cell.replace(/\r$/, ''));
      rows.push(row);
      row = [];
      cell = '';
    } else cell += c;
  }
  if (cell !== '' || row.length > 0) rows.push([...row, cell]);
  const head = rows.shift() ?? [];
  return rows
    .filter((r) => r.length === head.length)
    .map((r) => Object.fromEntries(head.map((name, i) => [name, r[i]!])));
}

/** Worst first: rows with a failure, then by the first column of errors that the table has. */
export function worstFirst(rows: readonly Record<string, string>[]): Record<string, string>[] {
  const column = ['nme', 'error', 'rotation', 'yaw_error', 'confidence'].find(
    (name) => rows[0] && name in rows[0],
  );
  const failed = (r: Record<string, string>) =>
    (Number(r.missed ?? 0) || 0) + (Number(r.wrong ?? 0) || 0) > 0 || r.found === '0';
  const misread = (r: Record<string, string>) => r.exact === '0';
  const badness = (r: Record<string, string>) => {
    const v = column ? Number(r[column]) : 0;
    return (
      (failed(r) ? 1e9 : misread(r) ? 1e6 : 0) + (Number.isFinite(v) ? (column === 'confidence' ? -v : v) : 0)
    );
  };
  return [...rows].sort((a, b) => badness(b) - badness(a));
}
