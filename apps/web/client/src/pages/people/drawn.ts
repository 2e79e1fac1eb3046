// Two synthetic people whom nobody is, to try things with.
import { api } from '../../api';
import { finishJob } from '../shared/jobs';

export const drawnNames = ['Ann (synthetic)', 'Ben (synthetic)'] as const;
const jobName = 'Two synthetic people';
const each = 10; // images of each to enrol

export interface Drawn {
  job: string;
  shots: [string[], string[]]; // files of the job, of each person
  others: string[]; // further images, to recognise
}

function drawnOf(id: string, files: readonly string[]): Drawn {
  const images = files.filter((name) => /^heads\/images\/\d+\.png$/.test(name)).sort();
  const of = (person: number) => images.filter((_, i) => i % 2 === person).slice(0, each);
  return { job: id, shots: [of(0), of(1)], others: images.slice(2 * each) };
}

// The job that drew them, if it is there; else it is started and waited for.
export async function drawnPeople(): Promise<Drawn> {
  const old = (await api.jobs()).find((job) => job.name === jobName && job.state === 'done');
  if (old) {
    const files = old.files ?? (await api.job(old.id)).files;
    const drawn = drawnOf(
      old.id,
      (files.length > 0 ? files : (await api.job(old.id)).files).map((one) => one.name),
    );
    if (drawn.others.length > 0) return drawn;
  }
  const job = await finishJob({
    verb: 'pose synth',
    inputs: [],
    flags: {
      '--output': 'out:heads',
      '--count': 2 * each + 6,
      '--people': 2,
      '--spread': 1.5,
      '--yaw': 12,
      '--pitch': 6,
      '--roll': 4,
      '--near': 400,
      '--far': 500,
      '--size': '480x360',
    },
    name: jobName,
  });
  return drawnOf(
    job.id,
    job.files.map((one) => one.name),
  );
}
