// Numbers and times as people read them.

export function bytesText(bytes: number): string {
  if (!Number.isFinite(bytes) || bytes < 0) return '';
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let unit = 0;
  while (bytes >= 1000 && unit < units.length - 1) {
    bytes /= 1000;
    unit += 1;
  }
  return `${unit === 0 || bytes >= 100 ? Math.round(bytes) : bytes.toFixed(1)} ${units[unit]}`;
}

export function pixelsText(pixels: number): string {
  if (!Number.isFinite(pixels) || pixels < 0) return '';
  return pixels < 1e6 ? `${pixels} px` : `${Number((pixels / 1e6).toPrecision(3))} million px`;
}

export function durationText(seconds: number): string {
  if (!Number.isFinite(seconds) || seconds < 0) return '';
  if (seconds < 60) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${Math.round(seconds % 60)} s`;
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return `${hours} h ${minutes % 60} min`;
  return `${Math.floor(hours / 24)} days`;
}

// With so many digits; never "-0.0".
export const numberText = (value: number, digits: number): string =>
  value.toFixed(digits).replace(/^-(0(\.0*)?)$/, '$1');

// The server's times are ISO text or seconds since 1970.
export function timeOf(value: string | number | null | undefined): Date | null {
  if (value === null || value === undefined || value === '' || value === 0) return null;
  const date = typeof value === 'number' ? new Date(value < 1e11 ? value * 1000 : value) : new Date(value);
  return Number.isNaN(date.getTime()) ? null : date;
}

export function timeText(value: string | number | null | undefined): string {
  const date = timeOf(value);
  if (!date) return '';
  const two = (number: number) => String(number).padStart(2, '0');
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
}

export const capital = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);

// What a session calls its action: "Pencil sketch". Its further keys, "(left arrow)", are the window's.
export const actionTitle = (action: { name: string; help: string }): string =>
  capital(action.help.replace(/ \([^)]*arrow[^)]*\)$/, '') || action.name.replaceAll('-', ' '));

const units: Record<string, string> = {
  ms: 'ms',
  us: 'µs',
  s: 's',
  px: 'px',
  bytes: 'bytes',
  kb: 'kB',
  mb: 'MB',
  gb: 'GB',
  fps: 'frames/s',
  percent: '%',
  deg: 'degrees',
  mm: 'mm',
};

// The name of a figure with its unit behind it: "corner_rms_px" is "corner rms, px", "corner_px_p95" is
// "corner p95, px". One of a unit alone is a time, a length or a size.
export function withUnit(name: string): string {
  const words = name.replaceAll('_', ' ').split(' ');
  const last = words.length - 1;
  const statistic = /^(p\d+|mean|median|min|max|std|sum)$/;
  const at = statistic.test(words[last] ?? '') && last > 0 ? last - 1 : last;
  const word = words[at] ?? '';
  const unit = units[word];
  if (unit === undefined) return words.join(' ');
  const rest = words.filter((_, i) => i !== at);
  const alone = /^(us|ms|s)$/.test(word) ? 'time' : word === 'px' ? 'length' : 'size';
  if (rest.length === 0 && !/^(us|ms|s|px|bytes|kb|mb|gb)$/.test(word)) return word;
  return `${rest.length === 0 ? alone : rest.join(' ')}, ${unit}`;
}

// A value of a state as one cell of a table.
export function cellText(value: unknown): string {
  if (value === null || value === undefined) return '–';
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  if (typeof value === 'number') {
    if (Number.isInteger(value)) return String(value);
    const size = Math.abs(value);
    return size >= 1000 ? value.toFixed(0) : size >= 1 ? value.toFixed(2) : value.toPrecision(3);
  }
  if (typeof value === 'string') return value === '' ? '–' : value;
  if (Array.isArray(value)) {
    if (value.length === 0) return 'none';
    if (value.length <= 4 && value.every((one) => typeof one !== 'object' || one === null)) {
      return value.map(cellText).join(', ');
    }
    return `${value.length} entries`;
  }
  return `${Object.keys(value).length} fields`;
}
