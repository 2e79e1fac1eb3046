// Jobs as the area pages use them: started, followed, their results read.
import { signal } from '@preact/signals';
import { useEffect } from 'preact/hooks';
import { useSignalValue } from '../../hooks';
import { api, call, type Job, type JobState, type Json, type StartRequest } from '../../api';
import { liveJobs, removedJobs, watchJobs } from '../../live';

const over: readonly JobState[] = ['done', 'failed', 'cancelled', 'interrupted'];

export const isOver = (job: Job | undefined): boolean => job !== undefined && over.includes(job.state);

// Jobs as last asked for; what comes live counts more while it is newer.
const asked = signal<ReadonlyMap<string, Job>>(new Map());

function remember(job: Job): void {
  asked.value = new Map(asked.value).set(job.id, job);
}

// A job as it changes, or undefined until it is known. When it is over it is asked for once more, for its files.
export function useJob(id: string | undefined): Job | undefined {
  const live = useSignalValue(liveJobs);
  const own = useSignalValue(asked);
  const removed = useSignalValue(removedJobs);
  let job: Job | undefined;
  if (id !== undefined && !removed.has(id)) {
    const answer = own.get(id);
    job = answer && isOver(answer) ? answer : (live.get(id) ?? answer);
  }
  const ended = isOver(job);
  useEffect(() => (id === undefined || ended ? undefined : watchJobs()), [id, ended]);
  useEffect(() => {
    if (id === undefined) return;
    let alive = true;
    const ask = () => {
      api.job(id).then(
        (answer) => {
          if (alive) remember(answer);
        },
        () => undefined,
      );
    };
    ask();
    // Should the live connection be away, the page still learns how far it is.
    const timer = ended ? undefined : setInterval(ask, 3000);
    return () => {
      alive = false;
      clearInterval(timer);
    };
  }, [id, ended]);
  return job;
}

// Starts a job and waits for its end, however it ends.
export async function settleJob(
  request: StartRequest,
  onJob?: (job: Job) => void,
  stop?: AbortSignal,
): Promise<Job> {
  let job = await api.startJob(request);
  const release = watchJobs();
  try {
    for (;;) {
      remember(job);
      onJob?.(job);
      if (isOver(job)) break;
      await wait(700, stop);
      const live = liveJobs.value.get(job.id);
      job = live && !isOver(live) ? live : await api.job(job.id);
    }
  } finally {
    release();
  }
  return job;
}

// The same; throws with the job's own words if it fails.
export async function finishJob(
  request: StartRequest,
  onJob?: (job: Job) => void,
  stop?: AbortSignal,
): Promise<Job> {
  const job = await settleJob(request, onJob, stop);
  if (job.state !== 'done') throw new Error(problemOfJob(job));
  return job;
}

export function problemOfJob(job: Job): string {
  if (job.state === 'cancelled') return 'The job was cancelled.';
  if (job.state === 'interrupted')
    return 'The job was interrupted because the server stopped. Start it again.';
  return job.error || `The job failed with status ${job.exit ?? 'unknown'}. See its log.`;
}

function wait(ms: number, stop?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, ms);
    stop?.addEventListener('abort', () => {
      clearTimeout(timer);
      reject(new DOMException('stopped', 'AbortError'));
    });
  });
}

export async function jobText(id: string, file: string): Promise<string> {
  return (await call(api.jobFileAddress(id, file))).text();
}

export async function jobJson<T>(id: string, file: string): Promise<T> {
  return (await (await call(api.jobFileAddress(id, file))).json()) as T;
}

export async function jobBlob(id: string, file: string): Promise<Blob> {
  return (await call(api.jobFileAddress(id, file))).blob();
}

// The last line of a job or run that is an object with this field.
export function lineWith<T>(lines: readonly Json[], field: string): T | undefined {
  for (let i = lines.length - 1; i >= 0; i--) {
    const line = lines[i];
    if (typeof line === 'object' && line !== null && !Array.isArray(line) && field in line) return line as T;
  }
  return undefined;
}
