// What the Plates page knows of events: pure functions of the lines of `plate log --json`.

export interface PlateEvent {
  id: number;
  text: string;
  confidence: number;
  country: string;
  source: string;
  first_time: string;
  last_time: string;
  frames: number;
  box: number[];
  crop: boolean;
  state: string;
  candidates: { text: string; confidence: number; country?: string }[];
  readings: { text: string; confidence: number; time: number; frame: number }[];
}

/** The event that a line of JSON holds, or null. */
export function eventOf(line: unknown): PlateEvent | null {
  if (typeof line !== 'object' || line === null) return null;
  const v = line as Record<string, unknown>;
  if (typeof v.id !== 'number' || typeof v.text !== 'string') return null;
  const list = (x: unknown) => (Array.isArray(x) ? x : []);
  const word = (x: unknown) => (typeof x === 'string' ? x : '');
  const num = (x: unknown) => (typeof x === 'number' && Number.isFinite(x) ? x : 0);
  return {
    id: v.id,
    text: v.text,
    confidence: num(v.confidence),
    country: word(v.country),
    source: word(v.source),
    first_time: word(v.first_time),
    last_time: word(v.last_time),
    frames: num(v.frames),
    box: list(v.box).map(num),
    crop: v.crop === true,
    state: word(v.state),
    candidates: list(v.candidates) as PlateEvent['candidates'],
    readings: list(v.readings) as PlateEvent['readings'],
  };
}

export interface Bar {
  /** First moment of the bar, ms. */
  start: number;
  count: number;
}

const hour = 3600 * 1000;

/** Events by hour, or by day where they span more than four days: at most 100 bars, the latest ones. */
export function histogram(times: readonly string[], zoneMinutes: number): { bars: Bar[]; step: number } {
  const ms = times.map((t) => Date.parse(t)).filter((t) => Number.isFinite(t));
  if (ms.length === 0) return { bars: [], step: hour };
  const first = Math.min(...ms);
  const last = Math.max(...ms);
  const step = last - first > 96 * hour ? 24 * hour : hour;
  const shift = zoneMinutes * 60 * 1000; // local time is UTC + shift
  const floor = (t: number) => Math.floor((t + shift) / step) * step - shift;
  const end = floor(last);
  const begin = Math.max(floor(first), end - 99 * step);
  const bars: Bar[] = [];
  for (let t = begin; t <= end; t += step) bars.push({ start: t, count: 0 });
  for (const t of ms) {
    const bar = bars[Math.round((floor(t) - begin) / step)];
    if (bar) bar.count++;
  }
  return { bars, step };
}

/** What `--since` takes, of what a person chooses. */
export const sinceChoices: readonly { value: string; label: string }[] = [
  { value: '', label: 'Any time' },
  { value: '1h', label: 'Last hour' },
  { value: '12h', label: 'Last 12 hours' },
  { value: '24h', label: 'Last day' },
  { value: '7d', label: 'Last week' },
  { value: '30d', label: 'Last 30 days' },
];

export interface Query {
  text: string;
  near: boolean;
  since: string;
  limit: number;
}

/** The flags of `plate log` for a query. */
export function flagsOf(query: Query): Record<string, string | number | boolean> {
  const flags: Record<string, string | number | boolean> = { '--limit': query.limit };
  const text = query.text.trim().toUpperCase();
  if (text !== '') {
    const hasWild = /[*?]/.test(text);
    flags['--text'] = query.near || hasWild ? text : `*${text}*`;
    if (query.near && !hasWild) flags['--near'] = true;
  }
  if (query.since !== '') flags['--since'] = query.since;
  return flags;
}

/** Letters and digits only, as plates are stored; null if there is nothing to store. */
export function cleanText(text: string): string | null {
  const clean = text.toUpperCase().replace(/[^\p{L}\p{N}]/gu, '');
  return clean.length > 0 && clean.length <= 20 ? clean : null;
}

/** The word for a confidence, so that colour is never alone. */
export function sureness(confidence: number): 'sure' | 'likely' | 'unsure' {
  return confidence >= 0.9 ? 'sure' : confidence >= 0.5 ? 'likely' : 'unsure';
}
