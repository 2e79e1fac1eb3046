// Annotations of the workspace: files of points that sessions made.
import { call } from '../../api';

export interface StateFile {
  name: string;
  bytes: number;
}

export async function annotations(): Promise<StateFile[]> {
  const answer = (await (await call('/api/state')).json()) as { files?: StateFile[] };
  return (answer.files ?? []).filter((one) => one.name.endsWith('.points.json'));
}

export const stateAddress = (name: string) => `/api/state/${encodeURIComponent(name)}`;
