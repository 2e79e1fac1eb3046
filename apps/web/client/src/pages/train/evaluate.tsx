// How good a model is: its figures beside those of what ships, worst cases first.
import { useEffect, useState } from 'preact/hooks';
import { api, verbHelp, type Flags, type Job, type VerbHelp } from '../../api';
import { cellText } from '../../format';
import { useJobs, useLoad } from '../../hooks';
import { JobCard, Notice, Select, Table, VerbForm } from '../../ui';
import { attempt } from '../../ui/toast';
import { addressOf } from '../shared/files';
import { isOver, jobText, useJob } from '../shared/jobs';
import { compare, parseCsv, comparisonText, worstFirst, type Comparison } from './curves';
import { DataSource } from './index';
import { InstallModel } from './install';
import {
  caseCell,
  caseColumns,
  caseLabel,
  sortMetrics,
  isMissed,
  evalRequest,
  evalVerbs,
  shippedModelOf,
  metricLabel,
} from './verbs';

interface Running {
  verb: number;
  model: string;
  mine: string | null;
  shipped: string | null;
}

export function Evaluate(props: { start: { model: string; verb: string; data: string } | null }) {
  const first = Math.max(
    0,
    evalVerbs.findIndex((one) => one.trains === props.start?.verb),
  );
  const [number, setNumber] = useState(first);
  const [data, setData] = useState(props.start?.data ?? '');
  const [model, setModel] = useState(props.start?.model ?? '');
  const [withShipped, setWithShipped] = useState('yes');
  const [verbs, setVerbs] = useState<VerbHelp[]>([]);
  const [running, setRunning] = useState<Running | null>(null);
  const trained = useJobs((job) => job.state === 'done');
  useEffect(() => {
    verbHelp().then(
      (help) => setVerbs(help.verbs),
      () => undefined,
    );
  }, []);
  const chosen = evalVerbs[number]!;
  const verb = verbs.find((one) => one.verb === chosen.verb);
  const models = useLoad(async () => {
    const jobs = trained.jobs.filter((job) => job.verb === chosen.trains).slice(0, 20);
    const all = await Promise.all(
      jobs.map(async (job) => ((job.files ?? []).length > 0 ? job : api.job(job.id))),
    );
    return all.flatMap((job) =>
      (job.files ?? [])
        .filter((file) => file.name.endsWith('.json') && !file.name.includes('/'))
        .map((file) => ({
          value: `job:${job.id}/${file.name}`,
          label: `${job.name || job.verb}, ${job.id}`,
        })),
    );
  }, [trained.jobs.map((job) => job.id).join(' '), number]);
  const options = [{ value: '', label: 'Only the shipped model' }, ...(models.value ?? [])];
  if (model !== '' && !options.some((one) => one.value === model))
    options.push({ value: model, label: model });

  const evaluate = async (flags: Flags) => {
    const start = async (which: string | null, name: string) => {
      const request = evalRequest(chosen, data, which, flags);
      return (await api.startJob({ verb: chosen.verb, ...request, name })).id;
    };
    await attempt(async () => {
      const mine = model === '' ? null : await start(model, `Evaluation: ${chosen.title}, your model`);
      const shipped =
        model === '' || withShipped === 'yes'
          ? await start(null, `Evaluation: ${chosen.title}, shipped model`)
          : null;
      setRunning({ verb: number, model, mine, shipped });
    });
  };

  return (
    <div class="split">
      <section class="card stack" aria-labelledby="what-to-evaluate">
        <h2 id="what-to-evaluate">Model to evaluate</h2>
        <Select
          label="Kind"
          value={String(number)}
          options={evalVerbs.map((one, i) => ({ value: String(i), label: one.title }))}
          onChange={(value) => {
            const next = Number(value);
            if (evalVerbs[next]!.data !== chosen.data) setData('');
            setModel('');
            setNumber(next);
          }}
        />
        <Select label="Model" value={model} options={options} onChange={setModel} />
        {model !== '' && (
          <Select
            label="Compare"
            value={withShipped}
            options={[
              { value: 'yes', label: 'with the shipped model' },
              { value: 'no', label: 'with no other model' },
            ]}
            onChange={setWithShipped}
          />
        )}
        {verb && (
          <VerbForm
            key={`${chosen.verb} ${chosen.model}`}
            verb={{ ...verb, inputs: [] }}
            inputs={data === '' ? [] : [data]}
            options={{ only: [...chosen.only] }}
            submit="Evaluate"
            ready={data !== ''}
            onSubmit={evaluate}
          >
            <DataSource kind={chosen.data} value={data} onChange={setData} />
            <p class="field-help">
              Evaluate on images that are not in the training set. With "hold out" 3 in training and "held
              out" 3 here, these are every third image.
            </p>
          </VerbForm>
        )}
      </section>
      <section class="stack" aria-labelledby="figures">
        <h2 id="figures">Figures</h2>
        {running ? (
          <Result key={`${running.mine} ${running.shipped}`} running={running} />
        ) : (
          <p class="faint">No evaluation yet.</p>
        )}
      </section>
    </div>
  );
}

// The object of figures that a job printed: the last line without an image's name.
function figuresOf(job: Job | undefined): unknown {
  const lines = job?.lines ?? [];
  for (let i = lines.length - 1; i >= 0; i--) {
    const line = lines[i];
    if (typeof line === 'object' && line !== null && !Array.isArray(line) && !('image' in line)) return line;
  }
  return undefined;
}

function Result({ running }: { running: Running }) {
  const mine = useJob(running.mine ?? undefined);
  const shipped = useJob(running.shipped ?? undefined);
  const main = mine ?? shipped;
  const ready =
    (running.mine === null || isOver(mine)) &&
    (running.shipped === null || isOver(shipped)) &&
    main !== undefined;
  const rows = ready ? sortMetrics(compare(figuresOf(mine), figuresOf(shipped))) : [];
  const place = shippedModelOf(evalVerbs[running.verb]!.trains);
  const word: Record<string, string> = { mine: 'your model', shipped: 'shipped model', same: 'equal' };
  const columns = [
    { name: 'Figure', show: (one: Comparison) => metricLabel(one.name) },
    ...(running.mine !== null
      ? [
          {
            name: 'Your model',
            show: (one: Comparison) => (one.mine === null ? '' : cellText(one.mine)),
            number: true,
          },
        ]
      : []),
    ...(running.shipped !== null
      ? [
          {
            name: 'Shipped model',
            show: (one: Comparison) => (one.shipped === null ? '' : cellText(one.shipped)),
            number: true,
          },
        ]
      : []),
    ...(running.mine !== null && running.shipped !== null
      ? [{ name: 'Better', show: (one: Comparison) => (one.better === null ? '' : word[one.better]) }]
      : []),
  ];
  return (
    <>
      {mine && <JobCard job={mine} />}
      {shipped && <JobCard job={shipped} />}
      {rows.length > 0 && <Table caption="Figures" columns={columns} rows={rows} keyOf={(one) => one.name} />}
      {ready && mine?.state === 'done' && place !== undefined && (
        <InstallModel model={running.model} place={place} comparison={comparisonText(rows)} />
      )}
      {ready && main && <WorstCases job={main} />}
    </>
  );
}

function WorstCases({ job }: { job: Job }) {
  const has = (job.files ?? []).some((file) => file.name === 'cases.csv');
  const cases = useLoad(
    async () => (has ? worstFirst(parseCsv(await jobText(job.id, 'cases.csv'))) : []),
    [job.id, has],
  );
  const found = useLoad(async () => {
    const points = new Map<string, [number, number][]>();
    if (!(job.files ?? []).some((file) => file.name === 'found.jsonl')) return points;
    for (const line of (await jobText(job.id, 'found.jsonl')).split('\n')) {
      if (line.trim() === '') continue;
      const one = JSON.parse(line) as { image?: string; faces?: { points?: [number, number][] }[] };
      const first = one.faces?.[0]?.points;
      if (one.image && Array.isArray(first)) points.set(one.image, first);
    }
    return points;
  }, [job.id]);
  if (!has) return null;
  const rows = cases.value ?? [];
  const names = caseColumns(Object.keys(rows[0] ?? {}));
  return (
    <>
      <h3>Worst cases first</h3>
      {cases.error && <Notice kind="problem">{cases.error}</Notice>}
      <ul class="thumbs thumbs-large">
        {rows.slice(0, 6).map((row) => (
          <li key={row.image}>
            <Case
              name={row.image ?? ''}
              data={job.inputs?.[0] ?? ''}
              points={found.value?.get(row.image ?? '')}
            />
            <span class="wrap">
              {(row.image ?? '').split('/').pop()}: {caseText(row)}
            </span>
          </li>
        ))}
      </ul>
      <Table
        caption="All cases"
        hideCaption
        columns={names.map((name) => ({
          name: caseLabel(name),
          show: (row: Record<string, string>) => caseCell(row, name),
          number: !['image', 'outcome', 'truth', 'text', 'exact', 'seen'].includes(name),
        }))}
        rows={rows.slice(0, 200)}
        keyOf={(_, i) => i}
      />
    </>
  );
}

function caseText(row: Record<string, string>): string {
  if (isMissed(row)) return row.truth === undefined ? 'not found' : `${row.truth} was not found`;
  if (row.wrong === '1') return 'another face';
  if (row.nme !== undefined) return `${Number(row.nme).toFixed(1)} %`;
  if (row.truth !== undefined) return `${row.truth} read as ${row.text || 'nothing'}`;
  return '';
}

// The image of a case with the points that were found.
function Case(props: { name: string; data: string; points: [number, number][] | undefined }) {
  const [size, setSize] = useState<{ w: number; h: number } | null>(null);
  // Names in the table are paths, or names beside the data.
  const base = props.data.replace(/\/[^/]*$/, '');
  const address =
    addressOf(props.name) ??
    (props.data.startsWith('job:') || props.data.startsWith('set:')
      ? addressOf(`${base}/${props.name}`)
      : null);
  if (!address) return <p class="faint">no image</p>;
  return (
    <span class="boxed">
      <img
        src={address}
        alt={`Image ${props.name.split('/').pop()}`}
        onLoad={(event) =>
          setSize({ w: event.currentTarget.naturalWidth, h: event.currentTarget.naturalHeight })
        }
      />
      {size && props.points && (
        <svg viewBox={`0 0 ${size.w} ${size.h}`} aria-hidden="true">
          {props.points.map((point, i) => (
            <circle key={i} class="found" cx={point[0]} cy={point[1]} r={size.w / 160} />
          ))}
        </svg>
      )}
    </span>
  );
}
