import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  actionTitle,
  bytesText,
  cellText,
  durationText,
  numberText,
  pixelsText,
  timeOf,
  timeText,
  withUnit,
} from '../src/format';
import { curlText, endpointsOf } from '../src/pages/api_page';
import { findingsOf } from '../src/pages/home';
import { tokenOf } from '../src/pages/sign_in';

test('sizes, times, cells', () => {
  assert.equal(bytesText(999), '999 B');
  assert.equal(bytesText(1530546), '1.5 MB');
  assert.equal(bytesText(-1), '');
  assert.equal(pixelsText(100_000_000), '100 million px');
  assert.equal(pixelsText(307_200), '307200 px');
  assert.equal(durationText(3.21), '3.2 s');
  assert.equal(durationText(125), '2 min 5 s');
  assert.equal(durationText(7300), '2 h 1 min');
  assert.equal(timeText(null), '');
  assert.equal(timeOf('no time'), null);
  assert.equal(timeOf(1_700_000_000)?.getTime(), 1_700_000_000_000);
  assert.equal(cellText([1, 2.5]), '1, 2.50');
  assert.equal(cellText({ a: 1 }), '1 fields');
  assert.equal(cellText(0.01234), '0.0123');
  assert.equal(cellText(null), '–');
  assert.equal(cellText('<img onerror=x>'), '<img onerror=x>');
});

test('figures with their units, actions with their titles', () => {
  assert.equal(numberText(-0.04, 1), '0.0');
  assert.equal(numberText(-0.06, 1), '-0.1');
  assert.equal(numberText(-0.4, 0), '0');
  assert.equal(withUnit('corner_rms_px'), 'corner rms, px');
  assert.equal(withUnit('corner_px_p95'), 'corner p95, px');
  assert.equal(withUnit('file_mb'), 'file, MB');
  assert.equal(withUnit('bytes'), 'size, bytes');
  assert.equal(withUnit('us'), 'time, µs');
  assert.equal(withUnit('fps'), 'fps');
  assert.equal(withUnit('mean_px'), 'mean, px');
  assert.equal(withUnit('faces'), 'faces');
  assert.equal(actionTitle({ name: 'go-on', help: 'confirm and continue' }), 'Confirm and continue');
  assert.equal(actionTitle({ name: 'go-on', help: '' }), 'Go on');
  assert.equal(actionTitle({ name: 'next', help: 'next patch (right arrow, space)' }), 'Next patch');
});

test('the token of a link', () => {
  assert.equal(tokenOf(' http://127.0.0.1:8765/#t=ab%2Bc '), 'ab+c');
  assert.equal(tokenOf('abc'), 'abc');
});

test('endpoints become curl calls', () => {
  const endpoints = endpointsOf({
    '/api/sets': {
      get: { summary: 'sets' },
      post: { requestBody: { content: { 'application/json': { example: { name: 'a' } } } } },
    },
    parameters: {},
  });
  assert.deepEqual(
    endpoints.map((one) => `${one.method} ${one.path}`),
    ['GET /api/sets', 'POST /api/sets'],
  );
  const post = endpoints[1];
  assert.ok(post);
  assert.match(curlText(post), /-X POST .*-d '\{"name":"holiday"\}' "\$TARSIER_URL"\/api\/sets$/);
  const own = { ...post, operation: { 'x-codeSamples': [{ lang: 'Shell', source: 'curl x' }] } };
  assert.equal(curlText(own), 'curl x');
});

test('findings of doctor', () => {
  assert.deepEqual(findingsOf([]), []);
  assert.deepEqual(findingsOf(['x']), []);
  assert.equal(findingsOf([{ items: [{ name: 'a' }] }]).length, 1);
});
