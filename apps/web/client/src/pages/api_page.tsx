import { useMemo, useState } from 'preact/hooks';
import { api, verbHelp, type Json, type OpenApiOperation, type RunResult, type VerbHelp } from '../api';
import { shellWord } from '../forms';
import { useLoad } from '../hooks';
import { attempt, CommandLine, Notice, PageHead, Select, Tabs, TextField, VerbForm } from '../ui';

interface Endpoint {
  method: string;
  path: string;
  operation: OpenApiOperation;
}

const METHODS = ['get', 'post', 'put', 'delete'];

export function endpointsOf(paths: Record<string, Record<string, OpenApiOperation>>): Endpoint[] {
  return Object.entries(paths).flatMap(([path, methods]) =>
    Object.entries(methods)
      .filter(([method]) => METHODS.includes(method))
      .map(([method, operation]) => ({ method: method.toUpperCase(), path, operation })),
  );
}

// A curl call of the endpoint: the server's own example, else one made of its description. It uses
// $TARSIER_URL and $TARSIER_TOKEN; names in braces stay for the reader to fill in.
export function curlText(endpoint: Endpoint): string {
  const sample = endpoint.operation['x-codeSamples']?.[0]?.source;
  if (sample) return sample;
  const words = ['curl', '-H', '"Authorization: Bearer $TARSIER_TOKEN"'];
  const content = Object.keys(endpoint.operation.requestBody?.content ?? {});
  if (endpoint.method !== 'GET') words.push('-X', endpoint.method);
  if (content.includes('application/json')) {
    words.push(
      '-H',
      "'Content-Type: application/json'",
      '-d',
      shellWord(bodyExample(endpoint.path, endpoint.operation)),
    );
  } else if (content.includes('multipart/form-data')) words.push('-F', 'file=@photo.jpg');
  else if (content.some((type) => type.startsWith('image/')))
    words.push('-H', "'Content-Type: image/jpeg'", '--data-binary', '@photo.jpg');
  else if (content.length > 0) words.push('--data-binary', '@FILE');
  words.push(`"$TARSIER_URL"${shellWord(endpoint.path)}`);
  return words.join(' ');
}

// Bodies that do something on any studio.
const BODIES: Record<string, Json> = {
  '/api/sets': { name: 'holiday' },
  '/api/sessions': { verb: 'cartoon run', inputs: ['synth:portrait?live=1'], flags: { '--mode': 'sketch' } },
  '/api/sessions/{id}/events': [{ action: 'sketch' }],
  '/api/jobs': { verb: 'sfm synth', inputs: [], flags: { '--output': 'out:scene' } },
  '/api/run': { verb: 'doctor', inputs: [], flags: {} },
  '/api/session': { token: 'TOKEN' },
};

function bodyExample(path: string, operation: OpenApiOperation): string {
  const own = BODIES[path];
  if (own !== undefined) return JSON.stringify(own);
  const body = operation.requestBody?.content?.['application/json'];
  if (body !== null && typeof body === 'object' && !Array.isArray(body) && body !== undefined) {
    const example = body['example'];
    if (example !== undefined) return JSON.stringify(example);
    const schema = body['schema'];
    if (
      schema !== null &&
      typeof schema === 'object' &&
      !Array.isArray(schema) &&
      schema?.['example'] !== undefined
    ) {
      return JSON.stringify(schema['example']);
    }
  }
  return '{}';
}

function Endpoints() {
  const openapi = useLoad(api.openapi);
  const info = useLoad(api.info);
  const [word, setWord] = useState('');
  const place = info.value?.workspace;
  const path = (typeof place === 'string' ? place : place?.path) ?? 'WORKSPACE';
  const settings = `export TARSIER_URL=${location.origin} TARSIER_TOKEN="$(cat ${shellWord(`${path}/.studio/api-token`)})"`;
  const all = useMemo(() => endpointsOf(openapi.value?.paths ?? {}), [openapi.value]);
  const shown = all.filter((one) =>
    `${one.method} ${one.path} ${one.operation.summary ?? ''}`.toLowerCase().includes(word.toLowerCase()),
  );
  return (
    <>
      {openapi.error && <Notice kind="problem">{openapi.error}</Notice>}
      <p>
        Programs sign in with a token: the file <code>.studio/api-token</code> of the workspace. The full
        description is <a href="/api/openapi.json">openapi.json</a>; metrics for Prometheus are at{' '}
        <a href="/metrics">/metrics</a>. The calls below use these variables:
      </p>
      <CommandLine text={settings} label="Address and token" />
      <TextField
        label="Filter"
        type="search"
        value={word}
        onInput={setWord}
        help={`${shown.length} of ${all.length} endpoints`}
      />
      <div class="endpoints">
        {shown.map((one) => (
          <details key={`${one.method} ${one.path}`}>
            <summary>
              <span class={`method method-${one.method.toLowerCase()}`}>{one.method}</span>{' '}
              <code>{one.path}</code> <span class="faint">{one.operation.summary}</span>
            </summary>
            {one.operation.description && <p>{one.operation.description}</p>}
            <CommandLine text={curlText(one)} label="curl" />
            {(one.operation.parameters ?? []).length > 0 && (
              <ul>
                {(one.operation.parameters ?? []).map((parameter) => (
                  <li key={parameter.name}>
                    <code>{parameter.name}</code>
                    {parameter.required ? ' (needed)' : ''}: {parameter.description ?? parameter.in}
                  </li>
                ))}
              </ul>
            )}
          </details>
        ))}
      </div>
    </>
  );
}

// The references of a text field: one a line.
const linesOf = (text: string) =>
  text
    .split('\n')
    .map((line) => line.trim())
    .filter((line) => line !== '');

export function TryVerb({ verb }: { verb: VerbHelp }) {
  const [text, setText] = useState('');
  const [answer, setAnswer] = useState<RunResult | null>(null);
  const inputs = linesOf(text);
  return (
    <>
      <p>{verb.help}.</p>
      <VerbForm
        verb={verb}
        inputs={inputs}
        options={{ output: true }}
        submit="Run"
        onSubmit={async (flags) => {
          const next = await attempt(() => api.run(verb.verb, inputs, flags));
          setAnswer(next ?? null);
        }}
      >
        {verb.inputs.length > 0 && (
          <div class="field">
            <label for="try-inputs">{verb.inputs.map((input) => input.names[0]).join(', ')}</label>
            <textarea
              id="try-inputs"
              rows={2}
              value={text}
              aria-describedby="try-inputs-help"
              onInput={(event) => setText(event.currentTarget.value)}
            />
            <p class="field-help" id="try-inputs-help">
              One per line: set:NAME, set:NAME/FILE, ws:FILE, job:ID/FILE, synth:portrait?frames=1
            </p>
          </div>
        )}
      </VerbForm>
      <div aria-live="polite">
        {answer && (
          <>
            <p>
              Exit status {answer.exit}, {Math.round(answer.ms)} ms.
            </p>
            {answer.error && <Notice kind="problem">{answer.error}</Notice>}
            {answer.files.length > 0 && (
              <ul>
                {answer.files.map((file) => (
                  <li key={file.name}>
                    <a download={file.name} href={`data:application/octet-stream;base64,${file.base64}`}>
                      {file.name}
                    </a>
                  </li>
                ))}
              </ul>
            )}
            <pre class="log" tabIndex={0} aria-label="Output">
              {answer.lines.map((line: Json) => JSON.stringify(line)).join('\n') || 'No output.'}
            </pre>
          </>
        )}
      </div>
    </>
  );
}

function Try() {
  const help = useLoad(verbHelp);
  const [chosen, setChosen] = useState('doctor');
  const verbs = help.value?.verbs ?? [];
  const verb = verbs.find((one) => one.verb === chosen);
  return (
    <>
      {help.error && <Notice kind="problem">{help.error}</Notice>}
      <Select
        label="Verb"
        value={chosen}
        options={verbs.map((one) => ({ value: one.verb, label: one.verb, group: one.area || 'general' }))}
        onChange={setChosen}
        help="A run returns within a minute. Start longer work as a job."
      />
      {verb && <TryVerb key={chosen} verb={verb} />}
    </>
  );
}

export function ApiPage() {
  const [tab, setTab] = useState('endpoints');
  return (
    <>
      <PageHead title="API" text="Other programs can do everything that these pages do." />
      <Tabs
        label="API"
        value={tab}
        onChange={setTab}
        tabs={[
          { id: 'endpoints', label: 'Endpoints' },
          { id: 'try', label: 'Try a verb' },
        ]}
      >
        {tab === 'endpoints' ? <Endpoints /> : <Try />}
      </Tabs>
    </>
  );
}
