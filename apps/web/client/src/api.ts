// The server's API, typed. Errors are ApiError with one plain line for the user.
import { signal } from '@preact/signals';

export class ApiError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

export type Json = null | boolean | number | string | Json[] | { [name: string]: Json };
export type FlagValue = string | number | boolean | (string | number)[];
export type Flags = Record<string, FlagValue>;

export interface SessionInfo {
  signed_in: boolean;
  csrf?: string;
  version: string;
  tls: boolean;
}

export interface Info {
  version: string;
  uptime?: number;
  tls?: boolean;
  workspace?: { path?: string; bytes?: number; free?: number; quota?: number } | string;
  machine?: { [name: string]: Json };
  limits?: { [name: string]: Json };
  [name: string]: unknown;
}

export interface FlagHelp {
  names: string[];
  positional: string | null;
  type: 'text' | 'switch' | 'integer' | 'number';
  choices: string[];
  suggestions: string[]; // words that a text may be, among other values
  headless_value: string | null; // opens no window, where the verb opens one without this flag
  range: { min: number | null; max: number | null; min_excluded: boolean; max_excluded?: boolean } | null;
  unit?: string; // of a number: "px", "s"
  default: string | number | boolean | null;
  values: number;
  repeatable: boolean;
  required: boolean;
  help: string;
  group: string;
  needs: string[];
  excludes: string[];
}

export interface VerbHelp {
  verb: string;
  path: string[];
  area: string;
  help: string;
  usage: string;
  example: string;
  inputs: FlagHelp[];
  flags: FlagHelp[];
  // If the verb opens a window unless it writes a file: the flags of which a run or a job must have one. The
  // list is empty if the verb works only in a window.
  needs_output?: string[];
}

export interface Help {
  program: string;
  version: string;
  verbs: VerbHelp[];
}

export type SourceKind = 'synth' | 'camera' | 'allowed' | 'viewer' | 'file';

export interface Source {
  id: string;
  name: string;
  kind: SourceKind;
  live: boolean;
}

export interface Action {
  name: string;
  help: string;
  key: number;
}

export interface SliderInfo {
  name: string;
  low: number;
  high: number;
  step: number;
  value: number;
}

export interface Hello {
  title: string;
  stages?: boolean; // images of its stages can be asked for
  actions: Action[];
  sliders: SliderInfo[];
}

export interface LiveState {
  status: string;
  state: { [name: string]: Json };
  frame: { index: number; time: number; name: string; age_ms: number; source: string } | null;
  sliders: Record<string, number>;
  finished: boolean;
  width: number;
  height: number;
}

export interface Session {
  id: string;
  verb: string;
  name: string;
  inputs: string[];
  flags: Flags;
  command: string;
  running: boolean;
  exit: number | null;
  error: string | null;
  title: string;
  actions: Action[];
  sliders: SliderInfo[];
  status: string;
  state: { [name: string]: Json };
  width: number;
  height: number;
  frames: number;
  fps: number;
  age_ms: number;
  viewers: number;
  stages?: boolean;
  log: string[];
}

export interface StartRequest {
  verb: string;
  inputs: string[];
  flags: Flags;
  name?: string;
}

export type SessionEvent =
  | { key: number; shift?: boolean; control?: boolean }
  | {
      mouse: MouseKind;
      x: number;
      y: number;
      width?: number;
      wheel?: number;
      shift?: boolean;
      control?: boolean;
    }
  | { action: string }
  | { slider: string; value: number };

export type MouseKind =
  | 'move'
  | 'left-down'
  | 'left-up'
  | 'right-down'
  | 'right-up'
  | 'middle-down'
  | 'middle-up'
  | 'wheel'
  | 'double';

export type JobState = 'queued' | 'running' | 'done' | 'failed' | 'cancelled' | 'interrupted';

export interface JobFile {
  name: string;
  bytes: number;
  kind: string;
}

export interface Job {
  id: string;
  verb: string;
  name: string;
  inputs?: string[];
  flags?: Flags;
  command: string;
  state: JobState;
  progress: { label: string; done: number; total: number; unit: string } | null;
  created: string | number;
  started: string | number | null;
  ended: string | number | null;
  exit: number | null;
  error: string | null;
  lines: Json[];
  files: JobFile[];
}

export interface SetInfo {
  name: string;
  files: number;
  bytes: number;
}

export interface SetFile {
  name: string;
  bytes: number;
  width: number;
  height: number;
  kind: 'image' | 'video' | 'other';
  modified: string | number;
}

export interface StateFile {
  name: string;
  bytes: number;
  modified: string | number;
  kind: string;
}

export interface SignIn {
  id: string;
  began: number;
  used: number;
  ends: number;
  address: string;
  used_from: string;
  browser: string;
  agent: string;
  own: boolean;
}

export interface RunResult {
  exit: number;
  lines: Json[];
  error: string;
  ms: number;
  command: string;
  files: { name: string; bytes: number; base64: string }[];
}

export interface OpenApi {
  openapi: string;
  info: { title: string; version: string; description?: string };
  paths: Record<string, Record<string, OpenApiOperation>>;
}

export interface OpenApiOperation {
  summary?: string;
  description?: string;
  operationId?: string;
  tags?: string[];
  parameters?: { name: string; in: string; required?: boolean; description?: string; schema?: Json }[];
  requestBody?: { content?: Record<string, Json>; required?: boolean };
  responses?: Record<string, Json>;
  'x-codeSamples'?: { lang: string; label?: string; source: string }[];
}

// Whether the viewer is signed in: undefined until the server said so.
export const signedIn = signal<boolean | undefined>(undefined);
export const serverInfo = signal<SessionInfo | undefined>(undefined);
// The last request did not reach the server.
export const offline = signal(false);

let csrf = '';

async function errorOf(response: Response): Promise<ApiError> {
  let message = '';
  try {
    const body = (await response.json()) as { error?: unknown };
    if (typeof body.error === 'string') message = body.error;
  } catch {
    // Not JSON: the status must do.
  }
  if (response.status === 401) signedIn.value = false;
  return new ApiError(
    response.status,
    message || `The server returned ${response.status} ${response.statusText}.`,
  );
}

export interface CallOptions {
  method?: string;
  json?: unknown;
  body?: BodyInit;
  type?: string;
  signal?: AbortSignal;
  accept?: string;
}

// One request; the answer is checked for errors, its body is not read yet.
export async function call(path: string, options: CallOptions = {}): Promise<Response> {
  const method = options.method ?? 'GET';
  const headers: Record<string, string> = {};
  let body = options.body;
  if (options.json !== undefined) {
    headers['Content-Type'] = 'application/json';
    body = JSON.stringify(options.json);
  } else if (options.type !== undefined) {
    headers['Content-Type'] = options.type;
  }
  if (options.accept !== undefined) headers['Accept'] = options.accept;
  if (method !== 'GET' && csrf !== '') headers['X-Tarsier-CSRF'] = csrf;
  let response: Response;
  try {
    response = await fetch(path, {
      method,
      headers,
      body,
      signal: options.signal,
      credentials: 'same-origin',
    });
  } catch (problem) {
    if (problem instanceof DOMException && problem.name === 'AbortError') throw problem;
    offline.value = true;
    throw new ApiError(0, 'The server does not respond. Check that tarsier serve is running.');
  }
  offline.value = false;
  if (!response.ok) throw await errorOf(response);
  return response;
}

async function json<T>(path: string, options: CallOptions = {}): Promise<T> {
  const response = await call(path, options);
  if (response.status === 204) return undefined as T;
  return (await response.json()) as T;
}

const part = encodeURIComponent;
// Names may have folders: each part is encoded, the slashes stay.
const parts = (path: string) => path.split('/').map(part).join('/');

export const api = {
  async session(): Promise<SessionInfo> {
    const answer = await json<SessionInfo>('/api/session');
    csrf = answer.csrf ?? '';
    serverInfo.value = answer;
    signedIn.value = answer.signed_in;
    return answer;
  },
  async signIn(token: string): Promise<void> {
    const answer = await json<{ csrf: string }>('/api/session', { method: 'POST', json: { token } });
    csrf = answer.csrf;
    await api.session();
  },
  async signOut(): Promise<void> {
    await json('/api/session', { method: 'DELETE' });
    csrf = '';
    signedIn.value = false;
  },
  info: () => json<Info>('/api/info'),
  help: () => json<Help>('/api/help'),
  openapi: () => json<OpenApi>('/api/openapi.json'),
  sources: async () => (await json<{ sources: Source[] }>('/api/sources')).sources,
  audit: () => json<{ [name: string]: Json }>('/api/audit'),

  signIns: () => json<{ sign_ins: SignIn[]; api_token: { made: number } }>('/api/sign-ins'),
  revokeSignIn: (id: string) => json<void>(`/api/sign-ins/${part(id)}`, { method: 'DELETE' }),
  revokeOtherSignIns: () => json<{ revoked: number }>('/api/sign-ins', { method: 'DELETE' }),
  renewApiToken: () => json<{ token: string; made: number }>('/api/api-token', { method: 'POST', json: {} }),

  addViewerCamera: async () =>
    (await json<{ id: string }>('/api/viewer-cameras', { method: 'POST', json: {} })).id,
  sendViewerFrame: (id: string, frame: Blob) =>
    json<void>(`/api/viewer-cameras/${viewerPart(id)}/frame`, {
      method: 'POST',
      body: frame,
      type: 'image/jpeg',
    }),
  removeViewerCamera: (id: string) =>
    json<void>(`/api/viewer-cameras/${viewerPart(id)}`, { method: 'DELETE' }),

  sessions: async () => (await json<{ sessions: Session[] }>('/api/sessions')).sessions,
  sessionOf: (id: string) => json<Session>(`/api/sessions/${part(id)}`),
  startSession: (request: StartRequest) => json<Session>('/api/sessions', { method: 'POST', json: request }),
  endSession: (id: string) => json<void>(`/api/sessions/${part(id)}`, { method: 'DELETE' }),
  sendEvents: (id: string, events: SessionEvent[]) =>
    json<void>(`/api/sessions/${part(id)}/events`, { method: 'POST', json: events }),
  // The stages of a frame that is newer than number `after`; null where none came.
  stages: async (id: string, after: number, signal_?: AbortSignal) => {
    const response = await call(`/api/sessions/${part(id)}/stages?after=${after}`, { signal: signal_ });
    if (response.status === 204) return null;
    const number = Number(response.headers.get('X-Tarsier-Stages') ?? '0');
    return { number, bytes: new Uint8Array(await response.arrayBuffer()) };
  },
  snapshotAddress: (id: string) => `/api/sessions/${part(id)}/snapshot.jpg`,

  sets: async () => (await json<{ sets: SetInfo[] }>('/api/sets')).sets,
  addSet: (name: string) => json<SetInfo>('/api/sets', { method: 'POST', json: { name } }),
  removeSet: (name: string) => json<void>(`/api/sets/${part(name)}`, { method: 'DELETE' }),
  setFiles: async (name: string) =>
    (await json<{ name: string; files: SetFile[] }>(`/api/sets/${part(name)}`)).files,
  setFileAddress: (set: string, file: string, width?: number) =>
    `/api/sets/${part(set)}/files/${part(file)}${width === undefined ? '' : `?width=${width}`}`,
  putSetFile: (set: string, file: string, body: Blob, signal_?: AbortSignal) =>
    json<unknown>(`/api/sets/${part(set)}/files/${part(file)}`, {
      method: 'PUT',
      body,
      type: body.type || 'application/octet-stream',
      signal: signal_,
    }),
  removeSetFile: (set: string, file: string) =>
    json<void>(`/api/sets/${part(set)}/files/${part(file)}`, { method: 'DELETE' }),

  // Files of the workspace that verbs made: camera files, annotations, the gallery.
  stateFiles: async () => (await json<{ files: StateFile[] }>('/api/state')).files,
  stateAddress: (name: string) => `/api/state/${part(name)}`,
  removeState: (name: string) => json<void>(`/api/state/${part(name)}`, { method: 'DELETE' }),

  run: (verb: string, inputs: string[] = [], flags: Flags = {}, signal_?: AbortSignal) =>
    json<RunResult>('/api/run', { method: 'POST', json: { verb, inputs, flags }, signal: signal_ }),

  jobs: async () => (await json<{ jobs: Job[] }>('/api/jobs')).jobs,
  job: (id: string) => json<Job>(`/api/jobs/${part(id)}`),
  startJob: (request: StartRequest) => json<Job>('/api/jobs', { method: 'POST', json: request }),
  cancelJob: (id: string) => json<void>(`/api/jobs/${part(id)}/cancel`, { method: 'POST', json: {} }),
  jobAgain: (id: string) => json<Job>(`/api/jobs/${part(id)}/again`, { method: 'POST', json: {} }),
  removeJob: (id: string) => json<void>(`/api/jobs/${part(id)}`, { method: 'DELETE' }),
  jobLog: async (id: string) => (await call(`/api/jobs/${part(id)}/log`)).text(),
  jobFileAddress: (id: string, file: string) => `/api/jobs/${part(id)}/files/${parts(file)}`,
};

// "viewer:ab12" as a source is camera "ab12" in the address.
function viewerPart(id: string): string {
  return part(id.startsWith('viewer:') ? id.slice('viewer:'.length) : id);
}

export function errorText(problem: unknown): string {
  if (problem instanceof ApiError) return problem.message;
  if (problem instanceof Error) return problem.message;
  return String(problem);
}

let helpOnce: Promise<Help> | undefined;

// The verbs and their flags; asked once.
export function verbHelp(): Promise<Help> {
  helpOnce ??= api.help().catch((problem: unknown) => {
    helpOnce = undefined;
    throw problem;
  });
  return helpOnce;
}
