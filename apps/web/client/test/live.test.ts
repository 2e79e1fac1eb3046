import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { Job } from '../src/api';
import { mergeJobs } from '../src/hooks';
import {
  backOff,
  KIND,
  LiveParser,
  imageOf,
  liveJobs,
  removedJobs,
  take,
  type LiveRecord,
} from '../src/live';

function record(kind: number, id: string, payload: Uint8Array): Uint8Array {
  const name = new TextEncoder().encode(id);
  const bytes = new Uint8Array(4 + 2 + name.length + payload.length);
  new DataView(bytes.buffer).setUint32(0, 2 + name.length + payload.length);
  bytes[4] = kind;
  bytes[5] = name.length;
  bytes.set(name, 6);
  bytes.set(payload, 6 + name.length);
  return bytes;
}

function joined(pieces: Uint8Array[]): Uint8Array {
  const bytes = new Uint8Array(pieces.reduce((sum, piece) => sum + piece.length, 0));
  let at = 0;
  for (const piece of pieces) {
    bytes.set(piece, at);
    at += piece.length;
  }
  return bytes;
}

const payload = (length: number, seed: number) =>
  Uint8Array.from({ length }, (_, i) => (i * 31 + seed) & 255);

const STREAM: [number, string, Uint8Array][] = [
  [KIND.hello, 'a1', new TextEncoder().encode('{"title":"x"}')],
  [KIND.image, 'a1', payload(5000, 1)],
  [KIND.ping, '', new Uint8Array(0)],
  [KIND.image, 'zwölf', payload(1, 2)],
  [KIND.state, 'a1', new Uint8Array(0)],
  [KIND.image, 'b', payload(70_000, 3)],
];

function same(records: LiveRecord[]): void {
  assert.equal(records.length, STREAM.length);
  records.forEach((one, index) => {
    const [kind, id, bytes] = STREAM[index] as [number, string, Uint8Array];
    assert.equal(one.kind, kind);
    assert.equal(one.id, id);
    assert.deepEqual(one.payload, bytes);
  });
}

test('records are parsed from pieces of any size', () => {
  const bytes = joined(STREAM.map(([kind, id, body]) => record(kind, id, body)));
  for (const size of [1, 2, 3, 4, 5, 7, 64, 1000, 4096, 65_536, bytes.length]) {
    const parser = new LiveParser();
    const records: LiveRecord[] = [];
    for (let at = 0; at < bytes.length; at += size)
      records.push(...parser.push(bytes.subarray(at, at + size)));
    same(records);
  }
});

test('records are parsed when split at any byte', () => {
  const bytes = joined(STREAM.map(([kind, id, body]) => record(kind, id, body)));
  for (let cut = 0; cut < 60; cut += 1) {
    const parser = new LiveParser();
    same([...parser.push(bytes.subarray(0, cut)), ...parser.push(bytes.subarray(cut))]);
  }
});

test('an empty piece changes nothing', () => {
  const parser = new LiveParser();
  assert.deepEqual(parser.push(new Uint8Array(0)), []);
});

test('malformed records are refused', () => {
  const short = new Uint8Array([0, 0, 0, 1, 1]);
  assert.throws(() => new LiveParser().push(short), /1 bytes/);
  const huge = new Uint8Array([255, 255, 255, 255, 1, 0]);
  assert.throws(() => new LiveParser().push(huge), /4294967295/);
  const longId = new Uint8Array([0, 0, 0, 2, 1, 9]);
  assert.throws(() => new LiveParser().push(longId), /id/);
});

test('an image has its number, its age and its bytes', () => {
  const image = imageOf(new Uint8Array([0, 0, 1, 2, 0, 0, 0, 40, 0xff, 0xd8]));
  assert.equal(image.frame, 258);
  assert.equal(image.ageMs, 40);
  assert.deepEqual([...image.jpeg], [0xff, 0xd8]);
  assert.throws(() => imageOf(new Uint8Array(7)));
});

test('the delay between reconnects grows to 8 s', () => {
  assert.deepEqual([0, 1, 2, 3, 4, 5, 50].map(backOff), [0.5, 1, 2, 4, 8, 8, 8]);
});

const jobOf = (id: string, state: string) => ({ id, verb: 'doctor', state }) as Job;
const tell = (job: object) =>
  take({ kind: KIND.job, id: 'j', payload: new TextEncoder().encode(JSON.stringify(job)) });
const statesOf = (jobs: Job[]) => jobs.map((job) => `${job.id} ${job.state}`);

test('a removed job leaves the list and comes back by nothing', () => {
  const loaded = { jobs: [jobOf('a', 'done'), jobOf('b', 'done')], before: liveJobs.value };
  tell(jobOf('a', 'running'));
  tell(jobOf('c', 'queued'));
  const all = () => statesOf(mergeJobs(loaded, liveJobs.value, removedJobs.value));
  assert.deepEqual(all(), ['a running', 'b done', 'c queued']);
  tell({ id: 'a', state: 'deleted' });
  tell({ id: 'b', state: 'deleted' });
  assert.equal(liveJobs.value.has('a'), false);
  assert.deepEqual(all(), ['c queued']);
});

test('a new list replaces what was known live before it', () => {
  const live = new Map([
    ['a', jobOf('a', 'running')],
    ['gone', jobOf('gone', 'running')],
  ]);
  const loaded = { jobs: [jobOf('a', 'cancelled')], before: live };
  assert.deepEqual(statesOf(mergeJobs(loaded, live, new Set())), ['a cancelled']);
  const later = new Map(live).set('a', jobOf('a', 'queued'));
  assert.deepEqual(statesOf(mergeJobs(loaded, later, new Set())), ['a queued'], 'started again');
  assert.deepEqual(mergeJobs(undefined, later, new Set()), []);
});
