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
  /** What somebody said that it really is. */
  correction: { text: string; author: string; time: string } | null;
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
    correction: correctionOf(v.correction),
  };
}

function correctionOf(value: unknown): PlateEvent['correction'] {
  if (typeof value !== 'object' || value === null) return null;
  const v = value as Record<string, unknown>;
  if (typeof v.text !== 'string') return null;
  return { text: v.text, author: String(v.author ?? ''), time: String(v.time ?? '') };
}

/** The text of a vehicle as far as it is known. */
export function textOf(event: PlateEvent): string {
  return event.correction?.text ?? event.text;
}

/** An entry of a watch list: a line of `plate watch list --json`. */
export interface WatchEntry {
  plate: string;
  label: string;
  errors: number;
  direction: string | null;
  hours: string | null;
  days: string | null;
}

export function watchEntryOf(line: unknown): WatchEntry | null {
  if (typeof line !== 'object' || line === null) return null;
  const v = line as Record<string, unknown>;
  if (typeof v.plate !== 'string') return null;
  const word = (x: unknown) => (typeof x === 'string' && x !== '' ? x : null);
  return {
    plate: v.plate,
    label: word(v.label) ?? '',
    errors: typeof v.errors === 'number' ? v.errors : 0,
    direction: word(v.direction),
    hours: word(v.hours),
    days: word(v.days),
  };
}

/** When an entry counts, in words. */
export function whenText(entry: WatchEntry): string {
  const parts = [entry.hours, entry.days, entry.direction].filter((one) => one !== null);
  return parts.length > 0 ? parts.join(', ') : 'always';
}

/** Whether a watch list takes these hours: "22:00-06:00", several with spaces between, or none. */
export function areHours(text: string): boolean {
  const isTime = (time: string) => /^([01]?\d|2[0-3]):[0-5]\d$/.test(time);
  return text
    .trim()
    .split(/\s+/)
    .filter((one) => one !== '')
    .every((one) => {
      const [from, to, more] = one.split('-');
      if (from === undefined || to === undefined || more !== undefined) return false;
      return isTime(from) && (isTime(to) || to === '24:00') && from !== to;
    });
}

/** A pattern for a watch list; null if the text is not one. */
export function cleanPattern(text: string): string | null {
  const clean = text.toUpperCase().replace(/[\s-]/g, '');
  return /^[A-Z0-9*?]{1,64}$/.test(clean) ? clean : null;
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
  const clean = text.toUpperCase().replace(/[^A-Z0-9]/g, '');
  return clean.length > 0 && clean.length <= 20 ? clean : null;
}

/** The word for a confidence, so that colour is never alone. */
export function confidenceLevel(confidence: number): 'high' | 'medium' | 'low' {
  return confidence >= 0.9 ? 'high' : confidence >= 0.5 ? 'medium' : 'low';
}
