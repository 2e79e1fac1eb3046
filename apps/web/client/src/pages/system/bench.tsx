// Measures this machine: `tarsier bench` as a job, its lines as a table.
import { useState } from 'preact/hooks';
import { api, verbHelp, type Job, type Json } from '../../api';
import { cellText } from '../../format';
import { useJobs, useLoad } from '../../hooks';
import { AsyncButton, JobCard, Notice, Select, Table } from '../../ui';
import { attempt } from '../../ui/toast';
import { useJob } from '../shared/jobs';
import { benchColumns, benchRows, type BenchRow } from './bench_table';

export function Bench() {
  const help = useLoad(verbHelp);
  const benches = (help.value?.verbs ?? []).filter(
    (verb) => verb.area === 'bench' || /^bench /.test(verb.verb),
  );
  const jobs = useJobs((job) => job.verb.startsWith('bench '));
  const [name, setName] = useState('bench posit');
  const [shown, setShown] = useState<string>();
  const current = shown ?? jobs.jobs[0]?.id;
  const job = useJob(current);
  const chosen = benches.find((one) => one.verb === name);
  return (
    <div class="stack">
      {help.error && <Notice kind="problem">{help.error}</Notice>}
      {jobs.error && <Notice kind="problem">{jobs.error}</Notice>}
      <section class="card stack" aria-labelledby="measure">
        <h2 id="measure">Measure this machine</h2>
        <Select
          label="Benchmark"
          value={name}
          options={benches.map((one) => ({ value: one.verb, label: one.verb.replace(/^bench /, '') }))}
          onChange={setName}
          help={chosen?.help ?? ''}
        />
        <div class="row">
          <AsyncButton
            kind="main"
            disabled={!chosen}
            run={async () => {
              const started = await attempt(() =>
                api.startJob({
                  verb: name,
                  inputs: [],
                  flags: {},
                  name: `Bench: ${name.replace(/^bench /, '')}`,
                }),
              );
              if (started) {
                setShown(started.id);
                jobs.again();
              }
            }}
          >
            Start the benchmark
          </AsyncButton>
        </div>
        <p class="field-help">
          It takes between a few seconds and a few minutes. Other programs on this machine slow it down.
        </p>
        {jobs.jobs.length > 1 && (
          <Select
            label="Earlier results"
            value={current ?? ''}
            options={jobs.jobs.map((one) => ({
              value: one.id,
              label: `${one.name || one.verb}, ${one.state}`,
            }))}
            onChange={setShown}
          />
        )}
      </section>
      {job && <JobCard job={job} files={false} onChange={jobs.again} />}
      {job && <Results job={job} />}
    </div>
  );
}

function Results({ job }: { job: Job }) {
  const rows = benchRows(job.lines ?? ([] as Json[]));
  if (rows.length === 0)
    return job.state === 'running' ? (
      <p class="faint">Each case is shown as soon as it is measured.</p>
    ) : null;
  return (
    <Table
      caption={`${job.verb.replace(/^bench /, '')}: ${rows.length} cases`}
      columns={benchColumns(rows).map(({ name, label, number }) => ({
        name: label,
        number,
        show: (row: BenchRow) => (name in row ? cellText(row[name] ?? null) : ''),
      }))}
      rows={rows}
      keyOf={(_, index) => index}
    />
  );
}
