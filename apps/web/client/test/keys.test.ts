import assert from 'node:assert/strict';
import { test } from 'node:test';
import { imagePoint, keyName, sessionKey, type KeyPress } from '../src/keys';

const press = (key: string, more: Partial<KeyPress> = {}): KeyPress => ({
  key,
  shiftKey: false,
  ctrlKey: false,
  altKey: false,
  metaKey: false,
  repeat: false,
  ...more,
});

test('keys have the codes of sessions', () => {
  assert.equal(sessionKey(press('s')), 115);
  assert.equal(sessionKey(press('S', { shiftKey: true })), 83);
  assert.equal(sessionKey(press('ArrowLeft')), 0x10001);
  assert.equal(sessionKey(press('ArrowDown')), 0x10004);
  assert.equal(sessionKey(press('Delete')), 0x10005);
  assert.equal(sessionKey(press('Enter')), 13);
  assert.equal(sessionKey(press(' ')), 32);
  assert.equal(sessionKey(press('+')), 43);
});

test('browser shortcuts are not intercepted', () => {
  assert.equal(sessionKey(press('Tab')), null);
  assert.equal(sessionKey(press('F5')), null);
  assert.equal(sessionKey(press('ä')), null);
  assert.equal(sessionKey(press('r', { ctrlKey: true })), null);
  assert.equal(sessionKey(press('c', { ctrlKey: true })), null);
  assert.equal(sessionKey(press('s', { altKey: true })), null);
  assert.equal(sessionKey(press('s', { metaKey: true })), null);
  assert.equal(sessionKey(press('z', { ctrlKey: true })), 122);
});

test('only some keys repeat', () => {
  assert.equal(sessionKey(press('s', { repeat: true })), null);
  assert.equal(sessionKey(press('ArrowRight', { repeat: true })), 0x10002);
  assert.equal(sessionKey(press('+', { repeat: true })), 43);
});

test('keys have names for people', () => {
  assert.equal(keyName(115), 's');
  assert.equal(keyName(32), 'Space');
  assert.equal(keyName(0x10002), '→');
  assert.equal(keyName(0), '');
});

test('points of the page are pixels of the image', () => {
  const box = { left: 10, top: 20, width: 320, height: 240 };
  assert.deepEqual(imagePoint({ clientX: 10, clientY: 20 }, box, { width: 640, height: 480 }), {
    x: -0.5,
    y: -0.5,
  });
  assert.deepEqual(imagePoint({ clientX: 170, clientY: 140 }, box, { width: 640, height: 480 }), {
    x: 319.5,
    y: 239.5,
  });
  // A box wider than the image: bars left and right.
  const wide = { left: 0, top: 0, width: 400, height: 100 };
  assert.deepEqual(imagePoint({ clientX: 200, clientY: 50 }, wide, { width: 100, height: 100 }), {
    x: 49.5,
    y: 49.5,
  });
  assert.deepEqual(imagePoint({ clientX: 150, clientY: 0 }, wide, { width: 100, height: 100 }), {
    x: -0.5,
    y: -0.5,
  });
});
