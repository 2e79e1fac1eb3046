import { useState } from 'preact/hooks';
import { api, type Json } from '../api';
import { TRIALS, type Trial } from '../areas';
import { useJobs, useLoad } from '../hooks';
import { AsyncButton, Button, Notice } from '../ui/controls';
import { JobCard } from '../ui/job_card';
import { OWN_CAMERA, startAndOpen } from '../ui/start_dialog';
import { cameraError } from '../viewer_camera';
import { AreaImage, Tarsier } from './area_image';

function TrialCard({ trial }: { trial: Trial }) {
  const { verb } = trial;
  return (
    <article class="card area" aria-label={trial.title}>
      <AreaImage id={trial.id} />
      <div class="area-body">
        <h2>{trial.title}</h2>
        <p>{trial.text}</p>
        <div class="row">
          {verb ? (
            <AsyncButton
              kind="main"
              aria-label={`Try it: ${trial.title}, with synthetic data`}
              run={() => startAndOpen({ verb, inputs: trial.inputs, flags: trial.flags })}
            >
              Try it
            </AsyncButton>
          ) : (
            <a
              class="button button-main"
              href={trial.start ?? trial.page}
              aria-label={`Try it: ${trial.title}, with synthetic data`}
            >
              Try it
            </a>
          )}
          {verb && trial.camera && !cameraError() && (
            <AsyncButton
              aria-label={`My camera: ${trial.title}`}
              run={() => startAndOpen({ verb, inputs: [OWN_CAMERA], flags: trial.flags })}
            >
              My camera
            </AsyncButton>
          )}
          {trial.page && (
            <a href={trial.page} aria-label={`More: ${trial.title}`}>
              More
            </a>
          )}
        </div>
      </div>
    </article>
  );
}

interface Finding {
  area: string;
  name: string;
  finding: string;
  value: string;
  advice: string;
}

export function findingsOf(lines: Json[]): Finding[] {
  const first = lines[0];
  if (first === undefined || first === null || typeof first !== 'object' || Array.isArray(first)) return [];
  const items = first['items'];
  return Array.isArray(items) ? (items as unknown as Finding[]) : [];
}

// What the machine lacks, in one line; all of it on the System page.
function FirstCheck() {
  const doctor = useLoad(() => api.run('doctor'));
  const findings = findingsOf(doctor.value?.lines ?? []);
  const bad = findings.filter((one) => one.finding !== 'ok' && one.finding !== 'note');
  const cameras = findings.find(
    (one) => one.area === 'cameras' && one.finding === 'ok' && one.name === 'V4L2',
  );
  if (doctor.error) return <Notice kind="problem">{doctor.error}</Notice>;
  if (findings.length === 0) return <p class="faint">Checking this machine.</p>;
  return (
    <Notice kind={bad.length > 0 ? 'problem' : 'good'}>
      {bad.length === 0
        ? `This machine is ready: all ${findings.length} checks passed.`
        : bad.map((one) => `${one.name}: ${one.value}. ${one.advice}`).join(' ')}{' '}
      {!cameras && 'It has no camera. Use synthetic data, or the camera of your phone or computer. '}
      <a href="/system">All checks</a>
    </Notice>
  );
}

export function Home() {
  const jobs = useJobs();
  const [all, setAll] = useState(false);
  const shown = jobs.jobs.slice(0, all ? 50 : 3);
  return (
    <>
      <div class="hero">
        <Tarsier />
        <div>
          <h1 tabIndex={-1}>What would you like to see?</h1>
          <p class="lead">
            Choose an area. It starts at once on a synthetic scene. Images stay on the machine that runs the
            studio.
          </p>
        </div>
      </div>
      <div class="areas">
        {TRIALS.map((trial) => (
          <TrialCard key={trial.id} trial={trial} />
        ))}
      </div>
      {cameraError() && <p class="faint camera-note">{cameraError()}</p>}
      <section class="section" aria-labelledby="recent">
        <h2 id="recent">Recent jobs</h2>
        {jobs.error && <Notice kind="problem">{jobs.error}</Notice>}
        {shown.length === 0 && !jobs.error && (
          <p class="faint">No jobs yet. Long work, such as a reconstruction or a training, is listed here.</p>
        )}
        <div class="grid">
          {shown.map((job) => (
            <JobCard key={job.id} job={job} onChange={jobs.again} />
          ))}
        </div>
        {jobs.jobs.length > 3 && (
          <Button small onClick={() => setAll(!all)}>
            {all ? 'Show fewer' : `Show all ${jobs.jobs.length} jobs`}
          </Button>
        )}
      </section>
      <section class="section" aria-labelledby="check">
        <h2 id="check">This machine</h2>
        <FirstCheck />
      </section>
    </>
  );
}
