// Annotations of the workspace: files of points that sessions made.
import { stateFiles, type StateFile } from '../shared/files';

export async function annotations(): Promise<StateFile[]> {
  return (await stateFiles()).filter((one) => one.name.endsWith('.points.json'));
}

export const stateAddress = (name: string) => `/api/state/${encodeURIComponent(name)}`;
