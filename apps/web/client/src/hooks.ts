import type { ReadonlySignal } from '@preact/signals';
import { useEffect, useState } from 'preact/hooks';
import { api, errorText, type Job } from './api';
import { liveJobs, watchJobs } from './live';

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

// All jobs, newest first, kept up to date while the component is shown.
export function useJobs(filter?: (job: Job) => boolean): {
  jobs: Job[];
  error: string;
  loading: boolean;
  again: () => void;
} {
  const loaded = useLoad(api.jobs);
  const live = useSignalValue(liveJobs);
  useEffect(() => watchJobs(), []);
  const jobs = new Map((loaded.value ?? []).map((job) => [job.id, job]));
  for (const [id, job] of live) {
    // A job that was removed comes back only by a new load.
    if (loaded.value !== undefined || jobs.has(id)) jobs.set(id, { ...jobs.get(id), ...job });
  }
  const all = [...jobs.values()].filter((job) => filter?.(job) ?? true);
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
