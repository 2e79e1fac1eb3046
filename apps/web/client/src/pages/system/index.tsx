import { useState } from 'preact/hooks';
import { api, type Json } from '../../api';
import { bytesText, capital, cellText, durationText, pixelsText } from '../../format';
import { useEvery, useLoad } from '../../hooks';
import {
  AsyncButton,
  attempt,
  Button,
  Confirm,
  Dialog,
  Timestamp,
  Notice,
  PageHead,
  Table,
  Tabs,
} from '../../ui';
import { findingsOf } from '../home';
import { Bench } from './bench';
import { SignIns } from './sign_ins';

interface Model {
  name: string;
  own: boolean;
  sha256: string | null;
  type: string;
  version: number | string;
  bytes: number;
  terms: string;
  used_by: string;
  without_it: string;
  problem: string | null;
}

type Row = { name: string; value: string };

// "memory_free_bytes": "Memory free".
function nameOf(key: string): string {
  const words = key
    .replace(/_(bytes|s)$/, '')
    .replaceAll('_', ' ')
    .replace(/^file$/, 'maximum size of a file')
    .replace(/^pixels$/, 'maximum size of an image')
    .replace('simd', 'vector instructions')
    .replace('tls', 'TLS (https)');
  return words.charAt(0).toUpperCase() + words.slice(1);
}

function rowsOf(value: unknown, name = ''): Row[] {
  if (value !== null && typeof value === 'object' && !Array.isArray(value)) {
    return Object.entries(value).flatMap(([key, one]) => rowsOf(one, name ? `${name}_${key}` : key));
  }
  const row = (text: string) => [{ name: nameOf(name), value: text }];
  if (typeof value === 'number' && name.endsWith('bytes')) return row(bytesText(value));
  if (typeof value === 'number' && name.endsWith('pixels')) return row(pixelsText(value));
  if (typeof value === 'number' && /(^|_)(uptime|seconds)(_s)?$/.test(name)) return row(durationText(value));
  return row(Array.isArray(value) ? value.map(cellText).join(', ') : cellText(value));
}

function Machine() {
  const info = useLoad(api.info);
  useEvery(10, info.again);
  if (info.error) return <Notice kind="problem">{info.error}</Notice>;
  const plain: { [name: string]: unknown } = {};
  const groups: [string, unknown][] = [];
  for (const [key, value] of Object.entries(info.value ?? {})) {
    if (value !== null && typeof value === 'object' && !Array.isArray(value))
      groups.push([nameOf(key), value]);
    else plain[key] = value;
  }
  return (
    <div class="grid grid-wide">
      {[['Server', plain] as [string, unknown], ...groups].map(([caption, value]) => (
        <Table
          key={caption}
          caption={caption}
          columns={[
            { name: 'Property', show: (row: Row) => row.name },
            { name: 'Value', show: (row: Row) => row.value },
          ]}
          rows={rowsOf(value)}
          keyOf={(row) => row.name}
          empty="Loading"
        />
      ))}
    </div>
  );
}

function Doctor() {
  const doctor = useLoad(() => api.run('doctor'));
  const findings = findingsOf(doctor.value?.lines ?? []);
  return (
    <>
      {doctor.error && <Notice kind="problem">{doctor.error}</Notice>}
      <Table
        caption="Checks of this machine, with advice on problems"
        columns={[
          {
            name: 'Result',
            show: (one) => (
              <span
                class={`chip ${one.finding === 'ok' ? 'chip-good' : one.finding === 'note' ? 'chip-info' : 'chip-bad'}`}
              >
                {one.finding}
              </span>
            ),
          },
          { name: 'Area', show: (one) => one.area },
          { name: 'Check', show: (one) => one.name },
          {
            name: 'Value',
            show: (one) => (
              <>
                {one.value}
                {one.advice && <div class="faint">{one.advice}</div>}
              </>
            ),
          },
        ]}
        rows={findings}
        keyOf={(one) => `${one.area} ${one.name}`}
        empty={doctor.loading ? 'Loading' : 'No checks.'}
      />
      <Button small onClick={doctor.again} busy={doctor.loading}>
        Check again
      </Button>
    </>
  );
}

function Models() {
  const models = useLoad(() => api.run('models list'));
  const [shown, setShown] = useState<{ name: string; lines: Json[] } | null>(null);
  const [verified, setVerified] = useState('');
  const [removed, setRemoved] = useState('');
  const rows = (models.value?.lines ?? []).filter(
    (line) => line !== null && typeof line === 'object' && 'name' in line,
  ) as unknown as Model[];
  return (
    <>
      {models.error && <Notice kind="problem">{models.error}</Notice>}
      <Table
        caption="Models"
        columns={[
          {
            name: 'Name',
            show: (model) => (
              <AsyncButton
                small
                aria-label={`About ${model.name}`}
                run={async () => {
                  const answer = await attempt(() => api.run('models info', [model.name]));
                  if (answer) setShown({ name: model.name, lines: answer.lines });
                }}
              >
                {model.name}
              </AsyncButton>
            ),
          },
          { name: 'Type and version', show: (model) => `${model.type} ${model.version}` },
          { name: 'Size', number: true, show: (model) => bytesText(model.bytes) },
          {
            name: 'Origin',
            show: (model) =>
              model.own ? (
                <>
                  <span class="chip chip-info">your own</span>{' '}
                  {model.sha256 && <span class="faint wrap">SHA-256 {model.sha256.slice(0, 12)}…</span>}{' '}
                  <Button
                    small
                    aria-label={`Restore the shipped model ${model.name}`}
                    onClick={() => setRemoved(model.name)}
                  >
                    Restore the shipped model
                  </Button>
                </>
              ) : (
                'ships'
              ),
          },
          { name: 'Terms', show: (model) => model.terms || 'not stated' },
          { name: 'Used by', show: (model) => model.used_by },
          {
            name: 'State',
            show: (model) => (model.problem ? <span class="problem-text">{model.problem}</span> : 'ok'),
          },
        ]}
        rows={rows}
        keyOf={(model) => model.name}
        empty={models.loading ? 'Loading' : 'No models.'}
      />
      <div class="row section-row">
        <AsyncButton
          small
          run={async () => {
            const answer = await attempt(() => api.run('models verify'));
            if (answer) {
              setVerified(
                answer.exit === 0
                  ? 'No file was changed since it was shipped or installed (SHA-256).'
                  : answer.error || differing(answer.lines),
              );
            }
          }}
        >
          Check the files’ hashes
        </AsyncButton>
        <span aria-live="polite">{verified}</span>
      </div>
      <Confirm
        title={`Restore the shipped model ${removed}?`}
        text="Your own model is removed from the models of the studio. The job that trained it keeps its file."
        yes="Remove my model"
        open={removed !== ''}
        onClose={() => setRemoved('')}
        onYes={() => {
          const name = removed;
          setRemoved('');
          void attempt(() => api.run('models remove', [name])).then(() => models.again());
        }}
      />
      <Dialog title={shown?.name ?? 'Model'} open={shown !== null} onClose={() => setShown(null)} wide>
        {(shown?.lines ?? []).map((line, index) => (
          <ModelDetails key={index} line={line} />
        ))}
      </Dialog>
    </>
  );
}

// The names of files that are not as they should be.
function differing(lines: Json[]): string {
  const names = lines.flatMap((line) =>
    line !== null && typeof line === 'object' && !Array.isArray(line) && line['ok'] === false
      ? [`${cellText(line['name'])} ${cellText(line['problem'])}`]
      : [],
  );
  return names.length > 0 ? `${names.join('; ')}.` : 'A file was changed.';
}

function ModelDetails({ line }: { line: Json }) {
  if (line === null || typeof line !== 'object' || Array.isArray(line)) return <p>{cellText(line)}</p>;
  const text = Object.entries(line).filter(([, value]) => typeof value === 'string' && value.includes('\n'));
  const rest = Object.fromEntries(
    Object.entries(line).filter(([key]) => !text.some(([name]) => name === key)),
  );
  return (
    <>
      <Table
        caption="Model details"
        hideCaption
        columns={[
          { name: 'Property', show: (row: Row) => row.name },
          { name: 'Value', show: (row: Row) => row.value },
        ]}
        rows={rowsOf(rest)}
        keyOf={(row) => row.name}
      />
      {text.map(([key, value]) => (
        <pre key={key} class="log" tabIndex={0} aria-label={key}>
          {String(value)}
        </pre>
      ))}
    </>
  );
}

export function auditRows(answer: { [name: string]: Json }): { [name: string]: Json }[] {
  const list = Object.values(answer).find(Array.isArray);
  return (list ?? []).map((entry) =>
    entry !== null && typeof entry === 'object' && !Array.isArray(entry) ? entry : { line: entry },
  );
}

const auditColumns: Record<string, string> = {
  time: 'Time',
  event: 'Event',
  what: 'Subject',
  count: 'Count',
  address: 'Address',
  browser: 'Browser',
  sign_in: 'Sign-in',
};

function auditCell(name: string, value: Json) {
  if (name === 'time' && typeof value === 'string') return <Timestamp at={value} />;
  return value === null ? '' : cellText(value);
}

function Audit() {
  const audit = useLoad(api.audit);
  const rows = auditRows(audit.value ?? {}).reverse();
  const names = [...new Set([...Object.keys(auditColumns), ...rows.flatMap((row) => Object.keys(row))])];
  return (
    <>
      {audit.error && <Notice kind="problem">{audit.error}</Notice>}
      <Table
        caption="Sign-ins, enrolments, deletions and exports, newest first. The log contains no images and no face templates."
        columns={names.map((name) => ({
          name: auditColumns[name] ?? capital(name.replaceAll('_', ' ')),
          show: (row: { [name: string]: Json }) => auditCell(name, row[name] ?? null),
        }))}
        rows={rows}
        keyOf={(_, index) => index}
        empty={audit.loading ? 'Loading' : 'No events yet.'}
      />
    </>
  );
}

interface Stored {
  key: string;
  kind: string;
  name: string;
  bytes: number;
  address: string;
  remove: () => Promise<void>;
}

// What the workspace holds, and how to be rid of it.
function Disk() {
  const sets = useLoad(api.sets);
  const states = useLoad(api.stateFiles);
  const [asked, setAsked] = useState<Stored | null>(null);
  const rows: Stored[] = [
    ...(sets.value ?? []).map((set) => ({
      key: `set:${set.name}`,
      kind: `set of ${set.files} ${set.files === 1 ? 'file' : 'files'}`,
      name: set.name,
      bytes: set.bytes,
      address: '',
      remove: () => api.removeSet(set.name),
    })),
    ...(states.value ?? []).map((state) => ({
      key: `ws:${state.name}`,
      kind: state.kind,
      name: state.name,
      bytes: state.bytes,
      address: api.stateAddress(state.name),
      remove: () => api.removeState(state.name),
    })),
  ];
  const error = sets.error || states.error;
  return (
    <>
      {error && <Notice kind="problem">{error}</Notice>}
      <Table
        caption="Uploaded sets, and permanent files of the workspace"
        columns={[
          {
            name: 'Name',
            show: (row) =>
              row.address ? (
                <a href={row.address} download={row.name}>
                  {row.name}
                </a>
              ) : (
                row.name
              ),
          },
          { name: 'Kind', show: (row) => row.kind },
          { name: 'Size', number: true, show: (row) => bytesText(row.bytes) },
          {
            name: 'Remove',
            show: (row) => (
              <Button small kind="danger" aria-label={`Remove ${row.name}`} onClick={() => setAsked(row)}>
                Remove
              </Button>
            ),
          },
        ]}
        rows={rows}
        keyOf={(row) => row.key}
        empty={sets.loading || states.loading ? 'Loading' : 'Nothing is stored yet.'}
      />
      <p class="faint">Jobs and their files are on the home page. Removing a job removes its files.</p>
      <Confirm
        title={`Remove ${asked?.name ?? ''}?`}
        text="It is deleted from the disk. This cannot be undone. To delete the data of a person with proof, use the page People."
        yes="Remove it"
        open={asked !== null}
        onClose={() => setAsked(null)}
        onYes={() => {
          const row = asked;
          setAsked(null);
          if (row)
            void attempt(row.remove).then(() => {
              sets.again();
              states.again();
            });
        }}
      />
    </>
  );
}

export function System() {
  const [tab, setTab] = useState('machine');
  return (
    <>
      <PageHead title="System" text="The machine, its models, its files, sign-ins and the audit log.">
        <AsyncButton run={() => attempt(api.signOut)}>Sign out</AsyncButton>
      </PageHead>
      <Tabs
        label="System"
        value={tab}
        onChange={setTab}
        tabs={[
          { id: 'machine', label: 'Machine' },
          { id: 'doctor', label: 'Checks' },
          { id: 'models', label: 'Models' },
          { id: 'bench', label: 'Benchmarks' },
          { id: 'disk', label: 'Disk' },
          { id: 'sign-ins', label: 'Sign-ins' },
          { id: 'audit', label: 'Audit log' },
        ]}
      >
        {tab === 'machine' && <Machine />}
        {tab === 'doctor' && <Doctor />}
        {tab === 'models' && <Models />}
        {tab === 'bench' && <Bench />}
        {tab === 'disk' && <Disk />}
        {tab === 'sign-ins' && <SignIns />}
        {tab === 'audit' && <Audit />}
      </Tabs>
    </>
  );
}
