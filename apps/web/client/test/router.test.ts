import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ownAddress, parseRoute } from '../src/router';

test('paths become pages', () => {
  assert.equal(parseRoute('/').page, '');
  assert.equal(parseRoute('/live').page, 'live');
  assert.equal(parseRoute('/live/').page, 'live');
  assert.deepEqual(parseRoute('/session/ab12?only=image').rest, ['ab12']);
  assert.equal(parseRoute('/session/ab12?only=image').query.get('only'), 'image');
  assert.deepEqual(parseRoute('/people/J%C3%BCrgen%2F2').rest, ['Jürgen/2']);
  assert.equal(parseRoute('/people#part').page, 'people');
});

test('unknown paths give the missing page', () => {
  for (const path of ['/nothing', '/session', '/session/a/b', '/constructor', '/__proto__']) {
    assert.equal(parseRoute(path).page, 'missing', path);
  }
  assert.deepEqual(parseRoute('/people/%E0%A4%A').rest, ['%E0%A4%A']);
});

test('the page follows plain clicks on its own links only', () => {
  const click = {
    button: 0,
    ctrlKey: false,
    metaKey: false,
    shiftKey: false,
    altKey: false,
    defaultPrevented: false,
  };
  const link = (href: string) => ({ href, target: '', download: '' });
  const origin = 'http://127.0.0.1:8765';
  assert.equal(ownAddress(click, link(`${origin}/live?x=1`), origin), '/live?x=1');
  assert.equal(ownAddress({ ...click, ctrlKey: true }, link(`${origin}/live`), origin), null);
  assert.equal(ownAddress({ ...click, button: 1 }, link(`${origin}/live`), origin), null);
  assert.equal(ownAddress({ ...click, defaultPrevented: true }, link(`${origin}/live`), origin), null);
  assert.equal(ownAddress(click, { ...link(`${origin}/live`), target: '_blank' }, origin), null);
  assert.equal(ownAddress(click, { ...link(`${origin}/live`), download: 'x' }, origin), null);
  assert.equal(ownAddress(click, link('http://other/live'), origin), null);
  assert.equal(ownAddress(click, link(`${origin}/api/openapi.json`), origin), null);
  assert.equal(ownAddress(click, link(`${origin}/metrics`), origin), null);
});
