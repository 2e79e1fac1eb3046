// Puts the gallery right, by the verbs `people correct ..`.
import { api, type Flags } from '../../api';

// One correction; its problem is thrown in the program's own words.
export async function correct(verb: string, inputs: string[], flags: Flags = {}): Promise<void> {
  const answer = await api.run(verb, inputs, flags);
  if (answer.exit !== 0) throw new Error(answer.error || 'Nothing was changed.');
}
