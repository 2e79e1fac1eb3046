import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { Action } from '../src/api';
import { keyOf, meaningOf, parseKeys, problemOfKey, withKey } from '../src/key_map';
import { WHOLE, widest, widthFor } from '../src/image_size';
import { groupsOf } from '../src/pages/shared/slider_groups';
import { parseStages } from '../src/stages';

const actions: Action[] = [
  { name: 'sketch', help: 'pencil sketch', key: 115 },
  { name: 'paint', help: 'oil paint', key: 112 },
  { name: 'quiet', help: '', key: 0 },
];
const none: ReadonlySet<number> = new Set();

test('keys of the viewer go before those of the program', () => {
  const own = withKey({}, actions[0]!, 120);
  assert.deepEqual(own, { sketch: 120 });
  assert.equal(keyOf(actions[0]!, own), 120);
  assert.equal(keyOf(actions[1]!, own), 112);
  assert.deepEqual(meaningOf(120, actions, own), { action: 'sketch' });
  assert.deepEqual(meaningOf(88, actions, own), { action: 'sketch' }, 'Shift does not matter');
  assert.equal(meaningOf(115, actions, own), 'nothing', 'its old key does nothing');
  assert.equal(meaningOf(112, actions, own), 'key');
  assert.equal(meaningOf(122, actions, own), 'key', 'keys without an action are the session’s');
  assert.deepEqual(withKey(own, actions[0]!, null), {});
  assert.deepEqual(withKey(own, actions[0]!, 115), {}, 'its own key is no change');
  // The old key of one may become that of another.
  assert.deepEqual(meaningOf(115, actions, { sketch: 120, paint: 115 }), { action: 'paint' });
});

test('a key triggers only one action', () => {
  assert.match(problemOfKey(112, 'sketch', actions, {}, none), /oil paint/);
  assert.match(problemOfKey(80, 'sketch', actions, {}, none), /oil paint/, 'large and small');
  assert.equal(problemOfKey(115, 'sketch', actions, {}, none), '');
  assert.equal(problemOfKey(112, 'sketch', actions, { paint: 120 }, none), '', 'it was given up');
  assert.match(problemOfKey(120, 'sketch', actions, { paint: 120 }, none), /oil paint/);
  assert.match(problemOfKey(27, 'sketch', actions, {}, none), /Escape/);
  assert.match(problemOfKey(113, 'sketch', actions, {}, new Set([113])), /reserved for the page/);
});

test('invalid stored keys are ignored', () => {
  assert.deepEqual(parseKeys(null), {});
  assert.deepEqual(parseKeys('{'), {});
  assert.deepEqual(parseKeys('[1]'), {});
  assert.deepEqual(parseKeys('"x"'), {});
  assert.deepEqual(parseKeys('{"a":null,"b":[],"cartoon run":{"sketch":120,"paint":"x","none":3}}'), {
    'cartoon run': { sketch: 120 },
  });
});

test('images are requested at the displayed width', () => {
  assert.equal(widthFor(300, 1), 320);
  assert.equal(widthFor(300, 2), 640);
  assert.equal(widthFor(320, 1), 320);
  assert.equal(widthFor(5000, 1), WHOLE);
  assert.equal(widthFor(0, 1), WHOLE, 'a place that is not laid out yet');
  assert.equal(widthFor(300, NaN), 320);
  assert.equal(widest([320, 640]), 640);
  assert.equal(widest([320, WHOLE, 640]), WHOLE);
  assert.equal(widest([]), 160, 'nobody paints');
});

test('sliders are grouped by the word before their number', () => {
  const slider = (name: string) => ({ name, low: 0, high: 1, step: 0.1, value: 0 });
  const names = ['shape 1', 'shape 2', 'threshold', 'look 1', 'shape 3', '3'];
  assert.deepEqual(
    groupsOf(names.map(slider)).map((group) => [group.name, group.sliders.map((one) => one.name)]),
    [
      ['shape', ['shape 1', 'shape 2', 'shape 3']],
      ['', ['threshold']],
      ['look', ['look 1']],
      ['', ['3']],
    ],
  );
});

function stagesOf(list: unknown, jpegs: number[], length?: number): Uint8Array {
  const text = new TextEncoder().encode(JSON.stringify(list));
  const bytes = new Uint8Array(8 + text.length + jpegs.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, 7);
  view.setUint32(4, length ?? text.length);
  bytes.set(text, 8);
  bytes.set(jpegs, 8 + text.length);
  return bytes;
}

test('stages are cut out of their record', () => {
  const one = { name: 'edges', width: 4, height: 3, bytes: 2 };
  const two = { name: 'mask', width: 2, height: 2, bytes: 1 };
  const stages = parseStages(stagesOf([one, two], [1, 2, 3]));
  assert.equal(stages.frame, 7);
  assert.deepEqual(
    stages.list.map((stage) => [stage.name, stage.width, stage.height, [...stage.jpeg]]),
    [
      ['edges', 4, 3, [1, 2]],
      ['mask', 2, 2, [3]],
    ],
  );
  assert.deepEqual(parseStages(stagesOf([], [])).list, []);
  assert.throws(() => parseStages(new Uint8Array(7)));
  assert.throws(() => parseStages(stagesOf([one], [1])), 'an image is cut short');
  assert.throws(() => parseStages(stagesOf([one], [1, 2], 1000)));
  assert.throws(() => parseStages(stagesOf({}, [])));
  assert.throws(() => parseStages(stagesOf([{ ...one, bytes: -1 }], [1, 2])));
  assert.throws(() => parseStages(stagesOf([{ ...one, name: 1 }], [1, 2])));
  assert.throws(() => parseStages(stagesOf([null], [])));
});
