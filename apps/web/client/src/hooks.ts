import type { ReadonlySignal } from '@preact/signals';
import { useEffect, useRef, useState } from 'preact/hooks';
import { api, errorText, type Job } from './api';
import { liveJobs, liveLink, removedJobs, watchJobs } from './live';

// The value of a signal as state: the component is drawn again when it changes.
export function useSignalValue<T>(signal: ReadonlySignal<T>): T {
  const [value, setValue] = useState<T>(() => signal.peek());
  useEffect(() => signal.subscribe((next) => setValue(() => next)), [signal]);
  return value;
}

export interface Loaded<T> {
  value: T | undefined;
  error: string;
  loading: boolean;
  again: () => void;
}

// Loads something when the page opens and when `keys` change.
export function useLoad<T>(load: () => Promise<T>, keys: readonly unknown[] = []): Loaded<T> {
  const [state, setState] = useState<{ value: T | undefined; error: string; loading: boolean }>({
    value: undefined,
    error: '',
    loading: true,
  });
  const [round, setRound] = useState(0);
  useEffect(() => {
    let current = true;
    setState((before) => ({ ...before, loading: true }));
    load().then(
      (value) => current && setState({ value, error: '', loading: false }),
      (problem: unknown) =>
        current && setState((before) => ({ value: before.value, error: errorText(problem), loading: false })),
    );
    return () => {
      current = false;
    };
  }, [...keys, round]);
  return { ...state, again: () => setRound((one) => one + 1) };
}

const when = (job: Job) => (typeof job.created === 'number' ? job.created : Date.parse(job.created) || 0);

// A list of jobs, and what was known live when it was asked for.
export interface LoadedJobs {
  jobs: readonly Job[];
  before: ReadonlyMap<string, Job>;
}

async function loadJobs(): Promise<LoadedJobs> {
  const before = liveJobs.peek();
  return { jobs: await api.jobs(), before };
}

// The loaded jobs with what came live since the list was asked for, and without the removed ones.
export function mergeJobs(
  loaded: LoadedJobs | undefined,
  live: ReadonlyMap<string, Job>,
  removed: ReadonlySet<string>,
): Job[] {
  const jobs = new Map((loaded?.jobs ?? []).map((job) => [job.id, job]));
  for (const [id, job] of live) {
    if (loaded !== undefined && loaded.before.get(id) !== job) jobs.set(id, { ...jobs.get(id), ...job });
  }
  for (const id of removed) jobs.delete(id);
  return [...jobs.values()];
}

// All jobs, newest first, kept up to date while the component is shown.
export function useJobs(filter?: (job: Job) => boolean): {
  jobs: Job[];
  error: string;
  loading: boolean;
  again: () => void;
} {
  const loaded = useLoad(loadJobs);
  const live = useSignalValue(liveJobs);
  const removed = useSignalValue(removedJobs);
  const link = useSignalValue(liveLink);
  const linkBefore = useRef(link);
  useEffect(() => watchJobs(), []);
  useEffect(() => {
    // A new connection tells nothing of the changes before it.
    if (link === 'open' && linkBefore.current !== 'open') loaded.again();
    linkBefore.current = link;
  }, [link]);
  const all = mergeJobs(loaded.value, live, removed).filter((job) => filter?.(job) ?? true);
  all.sort((a, b) => when(b) - when(a));
  return { jobs: all, error: loaded.error, loading: loaded.loading, again: loaded.again };
}

// Calls `run` each `seconds` while the tab is visible.
export function useEvery(seconds: number, run: () => void, keys: readonly unknown[] = []): void {
  useEffect(() => {
    const timer = setInterval(() => {
      if (document.visibilityState === 'visible') run();
    }, seconds * 1000);
    return () => clearInterval(timer);
  }, keys);
}
