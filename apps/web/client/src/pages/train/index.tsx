// Training models of one's own, and judging them.
import { useEffect, useState } from 'preact/hooks';
import { api, verbHelp, type Flags, type Job, type VerbHelp } from '../../api';
import { useJobs, useLoad, useSignalValue } from '../../hooks';
import { route } from '../../router';
import { Button, JobCard, Notice, PageHead, Select, Tabs, VerbForm } from '../../ui';
import { attempt } from '../../ui/toast';
import { annotations } from '../annotate/files';
import { finishJob, isOver, useJob } from '../shared/jobs';
import { SetSource } from '../shared/parts';
import { Chart } from './chart';
import { addSample, progressSeries, seriesOf, type Sample } from './curves';
import { Evaluate } from './evaluate';
import { InstallModel } from './install';
import {
  dataOfJob,
  synthRequest,
  shippedModelOf,
  trainRequest,
  trainVerbs,
  metricLabel,
  type DataKind,
} from './verbs';

export function Train() {
  const where = useSignalValue(route);
  const given = where.query.get('data') ?? '';
  const [tab, setTab] = useState('train');
  const [made, setMade] = useState<{ model: string; verb: string; data: string } | null>(null);
  return (
    <>
      <PageHead
        title="Train and evaluate"
        text="Train models on your own data, evaluate them, and compare them with the shipped models."
      />
      <Tabs
        label="Train and evaluate"
        tabs={[
          { id: 'train', label: 'Train' },
          { id: 'evaluate', label: 'Evaluate' },
        ]}
        value={tab}
        onChange={setTab}
      >
        {tab === 'train' && (
          <TrainPart
            given={given}
            onEvaluate={(model, verb, data) => {
              setMade({ model, verb, data });
              setTab('evaluate');
            }}
          />
        )}
        {tab === 'evaluate' && <Evaluate start={made} />}
      </Tabs>
    </>
  );
}

export interface DataChoice {
  value: string; // a reference
  label: string;
}

// All data of a kind that the workspace has: annotations, results of jobs, sets.
export function useData(kind: DataKind, round: unknown): DataChoice[] {
  const jobs = useJobs((job) => job.state === 'done');
  const points = useLoad(async () => (kind === 'points' ? annotations() : []), [kind, round]);
  const detailed = useLoad(async () => {
    // The list of jobs may leave the files out.
    const drawn = jobs.jobs.filter((job) => / synth$/.test(job.verb)).slice(0, 20);
    return Promise.all(drawn.map(async (job) => ((job.files ?? []).length > 0 ? job : api.job(job.id))));
  }, [jobs.jobs.map((job) => job.id).join(' '), round]);
  const choices: DataChoice[] = [];
  for (const file of points.value ?? [])
    choices.push({ value: `ws:${file.name}`, label: `Annotation ${file.name}` });
  for (const job of detailed.value ?? []) {
    const files = (job.files ?? []).map((one) => one.name);
    for (const path of dataOfJob(kind, files)) {
      choices.push({ value: `job:${job.id}/${path}`, label: `${job.name || job.verb}: ${path}` });
    }
  }
  return choices;
}

export function DataSource(props: { kind: DataKind; value: string; onChange: (value: string) => void }) {
  const [round, setRound] = useState(0);
  const [drawing, setDrawing] = useState(false);
  const choices = useData(props.kind, round);
  const draw = synthRequest(props.kind);
  const options = [{ value: '', label: 'Choose data' }, ...choices];
  if (props.value !== '' && !options.some((one) => one.value === props.value)) {
    options.push({ value: props.value, label: props.value });
  }
  return (
    <div class="stack">
      <Select label="Data" value={props.value} options={options} onChange={props.onChange} />
      {props.kind === 'plates' && (
        <SetSource
          kind="plates"
          label="Or images with a table truth.csv"
          help="The columns are image, x, y, w, h, text. Images without a table are examples without plates."
          accept="image/*,.csv"
          onSet={(set) => props.onChange(`set:${set}`)}
        />
      )}
      {draw && (
        <div class="row">
          <Button
            busy={drawing}
            onClick={() => {
              setDrawing(true);
              void attempt(async () => {
                const job = await finishJob({
                  verb: draw.verb,
                  inputs: draw.inputs,
                  flags: draw.flags,
                  name: 'Synthetic data',
                });
                props.onChange(`job:${job.id}/${draw.result}`);
                setRound(round + 1);
              }).finally(() => setDrawing(false));
            }}
          >
            Try with synthetic data
          </Button>
          {props.kind === 'points' && <a href="/annotate">Annotate your own images</a>}
        </div>
      )}
    </div>
  );
}

function TrainPart(props: {
  given: string;
  onEvaluate: (model: string, verb: string, data: string) => void;
}) {
  const [number, setNumber] = useState(0);
  const [data, setData] = useState(props.given);
  const [verbs, setVerbs] = useState<VerbHelp[]>([]);
  const [current, setCurrent] = useState<{ id: string; data: string } | null>(null);
  const all = useJobs((job) => trainVerbs.some((one) => one.verb === job.verb));
  useEffect(() => {
    verbHelp().then(
      (help) => setVerbs(help.verbs),
      () => undefined,
    );
  }, []);
  const chosen = trainVerbs[number]!;
  const verb = verbs.find((one) => one.verb === chosen.verb);
  const shown = current?.id ?? all.jobs[0]?.id;
  return (
    <div class="split">
      <section class="card stack" aria-labelledby="what-to-train">
        <h2 id="what-to-train">Model to train</h2>
        <Select
          label="Model"
          value={String(number)}
          options={trainVerbs.map((one, i) => ({ value: String(i), label: one.title }))}
          onChange={(value) => {
            const next = Number(value);
            if (trainVerbs[next]!.data !== chosen.data) setData('');
            setNumber(next);
          }}
        />
        {verb && (
          <VerbForm
            key={chosen.verb}
            verb={{ ...verb, inputs: [] }}
            inputs={data === '' ? [] : [data]}
            options={{ only: [...chosen.only] }}
            submit="Train"
            ready={chosen.data === 'gallery' || data !== ''}
            onSubmit={async (flags: Flags) => {
              const request = trainRequest(chosen, data, flags);
              const job = await attempt(() =>
                api.startJob({
                  verb: chosen.verb,
                  ...request,
                  name: `${chosen.title.split(':')[0]}: ${chosen.output || 'gallery'}`,
                }),
              );
              if (job) {
                setCurrent({ id: job.id, data });
                all.again();
              }
            }}
          >
            {chosen.data !== 'gallery' && <DataSource kind={chosen.data} value={data} onChange={setData} />}
          </VerbForm>
        )}
      </section>
      <section class="stack" aria-labelledby="training">
        <h2 id="training">Training</h2>
        {all.error && <Notice kind="problem">{all.error}</Notice>}
        {shown === undefined && <p class="faint">No training yet.</p>}
        {shown !== undefined && (
          <Training key={shown} id={shown} onChange={all.again} onEvaluate={props.onEvaluate} />
        )}
        {all.jobs.length > 1 && (
          <Select
            label="Earlier"
            value={shown ?? ''}
            options={all.jobs.map((job) => ({
              value: job.id,
              label: `${job.name || job.verb}, ${job.state}`,
            }))}
            onChange={(id) => setCurrent({ id, data: '' })}
          />
        )}
      </section>
    </div>
  );
}

function dataOf(job: Job): string {
  const inputs = job.inputs ?? [];
  return inputs[0] ?? '';
}

function Training(props: {
  id: string;
  onChange: () => void;
  onEvaluate: (model: string, verb: string, data: string) => void;
}) {
  const job = useJob(props.id);
  const [samples, setSamples] = useState<Sample[]>([]);
  useEffect(() => {
    const now = job?.progress;
    if (!now || now.total <= 0) return;
    setSamples((before) =>
      addSample(before, { label: now.label, share: now.done / now.total, at: Date.now() }),
    );
  }, [job]);
  if (!job) return <p class="faint">Loading</p>;
  const printed = seriesOf(job.lines ?? []);
  const model = (job.files ?? []).find((one) => one.name.endsWith('.json') && !one.name.includes('/'));
  const last = [...(job.lines ?? [])]
    .reverse()
    .find((one) => typeof one === 'object' && one !== null && !Array.isArray(one));
  const numbers = Object.entries((last ?? {}) as Record<string, unknown>).filter(
    (entry): entry is [string, number] => typeof entry[1] === 'number',
  );
  return (
    <>
      <JobCard job={job} onChange={props.onChange} />
      {printed.length > 0 ? (
        <Chart title="Measured during the training" series={printed} x="" y="Value" />
      ) : (
        samples.length > 1 && (
          <Chart title="Progress of each step, %" series={progressSeries(samples)} x="s" y="%" />
        )
      )}
      {isOver(job) && numbers.length > 0 && (
        <dl class="state-list">
          {numbers.slice(0, 10).map(([name, value]) => (
            <div key={name}>
              <dt>{metricLabel(name)}</dt>
              <dd>{Number.isInteger(value) ? value : value.toPrecision(4)}</dd>
            </div>
          ))}
        </dl>
      )}
      {job.state === 'done' && model && (
        <div class="row">
          <Button
            kind="main"
            onClick={() => props.onEvaluate(`job:${job.id}/${model.name}`, job.verb, dataOf(job))}
          >
            Evaluate this model
          </Button>
          <a href={api.jobFileAddress(job.id, model.name)} download={model.name}>
            Download {model.name}
          </a>
        </div>
      )}
      {job.state === 'done' && model && shippedModelOf(job.verb) !== undefined && (
        <details>
          <summary>Install without an evaluation</summary>
          <InstallModel
            model={`job:${job.id}/${model.name}`}
            place={shippedModelOf(job.verb)!}
            comparison=""
          />
        </details>
      )}
    </>
  );
}
