// Files that go to the server and come from it.
import { api, type RunResult } from '../../api';
import { jobBlob } from './jobs';

// A name for a set that the server takes: letters, digits, - and _; with the time, so that it is new.
export function setName(kind: string, now = new Date()): string {
  const two = (n: number) => String(n).padStart(2, '0');
  const day = `${now.getFullYear()}${two(now.getMonth() + 1)}${two(now.getDate())}`;
  const time = `${two(now.getHours())}${two(now.getMinutes())}${two(now.getSeconds())}`;
  return `${cleanName(kind)}-${day}-${time}`;
}

export function cleanName(text: string): string {
  const clean = text
    .normalize('NFKD')
    .replace(/[^A-Za-z0-9_-]+/g, '-')
    .replace(/^-+|-+$/g, '');
  return clean === '' ? 'set' : clean.slice(0, 40);
}

// A file name that is safe in a set: no folders, and none twice.
export function fileName(name: string, usedNames: Set<string>): string {
  const base =
    (name.split(/[\\/]/).pop() ?? '').replace(/[^\p{L}\p{N}._ -]+/gu, '_').replace(/^\.+/, '') || 'file';
  let result = base;
  for (let i = 2; usedNames.has(result.toLowerCase()); i++) {
    const dot = base.lastIndexOf('.');
    result = dot > 0 ? `${base.slice(0, dot)}-${i}${base.slice(dot)}` : `${base}-${i}`;
  }
  usedNames.add(result.toLowerCase());
  return result;
}

export interface UploadState {
  done: number;
  total: number;
  refused: { name: string; reason: string }[];
}

// Puts files into a set that is there, three at a time. A file that is refused does not stop the others.
// `present`: names in the set that are not replaced.
export async function uploadAll(
  set: string,
  files: readonly { name: string; body: Blob }[],
  onState: (state: UploadState) => void,
  present: readonly string[] = [],
): Promise<UploadState> {
  const state: UploadState = { done: 0, total: files.length, refused: [] };
  const usedNames = new Set(present.map((name) => name.toLowerCase()));
  const waiting = files.map((file) => ({ name: fileName(file.name, usedNames), body: file.body }));
  onState({ ...state });
  const work = async () => {
    for (let next = waiting.shift(); next; next = waiting.shift()) {
      try {
        await api.putSetFile(set, next.name, next.body);
      } catch (problem) {
        state.refused.push({
          name: next.name,
          reason: problem instanceof Error ? problem.message : String(problem),
        });
      }
      state.done += 1;
      onState({ ...state, refused: [...state.refused] });
    }
  };
  await Promise.all([work(), work(), work()]);
  return state;
}

// Copies results of a job into a set, so that they can be used like uploads.
export async function copyToSet(
  job: string,
  names: readonly string[],
  set: string,
  onState: (state: UploadState) => void = () => undefined,
): Promise<UploadState> {
  const files = [];
  for (const name of names) files.push({ name, body: await jobBlob(job, name) });
  return uploadAll(set, files, onState);
}

// Offers bytes to the viewer as a download.
export function save(name: string, body: Blob): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(body);
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// Where the page finds the file that a verb named: a reference (set:NAME/FILE, job:ID/PATH, ws:NAME), or a path
// of the workspace as it stands in tables. Null for anything else.
export function addressOf(name: string, width?: number): string | null {
  const found =
    /^(set|job|ws):([^/]+)(?:\/(.+))?$/.exec(name) ??
    /\/(sets)\/([^/]+)\/(.+)$/.exec(name) ??
    /\/(jobs)\/([^/]+)\/files\/(.+)$/.exec(name);
  if (!found) return null;
  const [, kind, first, rest] = found;
  if (kind === 'ws') return `/api/state/${encodeURIComponent(first!)}`;
  if (!rest) return null;
  if (kind === 'job' || kind === 'jobs') return api.jobFileAddress(first!, rest);
  return api.setFileAddress(first!, rest, width);
}

export async function hasState(name: string): Promise<boolean> {
  return (await api.stateFiles()).some((one) => one.name === name);
}

// A file that a run wrote, where it did; the server keeps nothing of it.
export function blobOfRun(answer: RunResult, name: string): Blob | null {
  const file = answer.files.find((one) => one.name === name);
  if (!file) return null;
  return new Blob([Uint8Array.from(atob(file.base64), (letter) => letter.charCodeAt(0))]);
}
