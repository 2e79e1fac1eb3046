// Annotations of the workspace: files of points that sessions made.
import { api, type StateFile } from '../../api';

export async function annotations(): Promise<StateFile[]> {
  return (await api.stateFiles()).filter((one) => one.name.endsWith('.points.json'));
}

export const stateAddress = (name: string) => `/api/state/${encodeURIComponent(name)}`;
