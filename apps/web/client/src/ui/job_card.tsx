import { useState } from 'preact/hooks';
import { api, type Job } from '../api';
import { bytesText, durationText, timeOf, timeText } from '../format';
import { useLoad } from '../hooks';
import { AsyncButton, CommandLine, Dialog, Progress } from './controls';
import { attempt, toast } from './toast';

const WORDS: Record<Job['state'], string> = {
  queued: 'waiting',
  running: 'running',
  done: 'done',
  failed: 'failed',
  cancelled: 'cancelled',
  interrupted: 'interrupted by a restart of the server',
};

export function jobTime(job: Job): string {
  const from = timeOf(job.started);
  const to = timeOf(job.ended);
  if (!from || !to) return '';
  return durationText((to.getTime() - from.getTime()) / 1000);
}

// One job: what it is, how far, what came of it; cancel, again, log, remove.
export function JobCard(props: { job: Job; onChange?: () => void; files?: boolean }) {
  const { job } = props;
  const [log, setLog] = useState<string | null>(null);
  const active = job.state === 'running' || job.state === 'queued';
  // The list of jobs leaves their files out: they are asked for when somebody looks.
  const [asked, setAsked] = useState(false);
  const whole = useLoad<Job | null>(
    async () => (asked && !active ? api.job(job.id) : null),
    [asked, job.id, job.state],
  );
  const files = whole.value?.files ?? job.files ?? [];
  const act = async (run: () => Promise<unknown>, said: string) => {
    const answer = await attempt(async () => {
      await run();
      return true;
    });
    if (answer) toast(said, 'good');
    props.onChange?.();
  };
  return (
    <article class={`card job job-${job.state}`} aria-label={`Job ${job.name || job.verb}`}>
      <div class="job-head">
        <h3>{job.name || job.verb}</h3>
        <span class={`chip chip-${job.state}`}>{WORDS[job.state] ?? job.state}</span>
      </div>
      <p class="faint">
        {job.name && job.name !== job.verb ? `${job.verb}, ` : ''}
        {timeText(job.created)}
        {jobTime(job) ? `, took ${jobTime(job)}` : ''}
      </p>
      {job.state === 'running' && (
        <Progress
          label={job.progress?.label ?? 'Running'}
          done={job.progress?.done ?? 0}
          total={job.progress?.total ?? 0}
          unit={job.progress?.unit}
        />
      )}
      {job.error && <p class="problem-text">{job.error}</p>}
      {props.files !== false && !active && (
        <details onToggle={(event) => event.currentTarget.open && setAsked(true)}>
          <summary>Files</summary>
          {files.length === 0 && <p class="faint">{whole.loading || !asked ? 'Loading' : 'No files.'}</p>}
          <ul class="file-list">
            {files.map((file) => (
              <li key={file.name}>
                <a href={api.jobFileAddress(job.id, file.name)} download={file.name.split('/').pop()}>
                  {file.name}
                </a>{' '}
                <span class="faint">{bytesText(file.bytes)}</span>
              </li>
            ))}
          </ul>
        </details>
      )}
      <div class="row">
        {active && (
          <AsyncButton
            small
            kind="danger"
            run={() => act(() => api.cancelJob(job.id), 'The job is being cancelled.')}
          >
            Cancel
          </AsyncButton>
        )}
        {!active && job.state !== 'done' && (
          <AsyncButton small run={() => act(() => api.jobAgain(job.id), 'The job was started again.')}>
            Start again
          </AsyncButton>
        )}
        <AsyncButton small run={async () => setLog((await attempt(() => api.jobLog(job.id))) ?? null)}>
          Log
        </AsyncButton>
        {!active && (
          <AsyncButton
            small
            kind="quiet"
            run={() => act(() => api.removeJob(job.id), 'The job and its files were removed.')}
          >
            Remove
          </AsyncButton>
        )}
      </div>
      <Dialog title={`Log of ${job.name || job.verb}`} open={log !== null} onClose={() => setLog(null)} wide>
        <CommandLine text={job.command} />
        <pre class="log" tabIndex={0} aria-label="Log">
          {log || 'The log is empty.'}
        </pre>
      </Dialog>
    </article>
  );
}
