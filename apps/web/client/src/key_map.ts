// Keys that the viewer gave to actions instead of the program's own, kept in this browser. All but the store is pure.
import { signal } from '@preact/signals';
import type { Action } from './api';
import { keyName } from './keys';

// Of one verb: action -> code of its key.
export type OwnKeys = Readonly<Record<string, number>>;

const STORE = 'tarsier.keys';

// What was stored; whatever is broken is left out.
export function parseKeys(text: string | null): Record<string, OwnKeys> {
  let value: unknown;
  try {
    value = JSON.parse(text ?? '{}');
  } catch {
    return {};
  }
  const result: Record<string, OwnKeys> = {};
  if (value === null || typeof value !== 'object' || Array.isArray(value)) return result;
  for (const [verb, keys] of Object.entries(value)) {
    if (keys === null || typeof keys !== 'object' || Array.isArray(keys)) continue;
    const good = Object.entries(keys as Record<string, unknown>).filter(
      (entry): entry is [string, number] => typeof entry[1] === 'number' && keyName(entry[1]) !== '',
    );
    if (good.length > 0) result[verb] = Object.fromEntries(good);
  }
  return result;
}

// Large and small letters are one key of the keyboard.
const same = (a: number, b: number) => {
  const small = (code: number) => (code >= 65 && code <= 90 ? code + 32 : code);
  return small(a) === small(b);
};

// The key of an action: the viewer's, else the program's; 0 for none.
export const keyOf = (action: Action, own: OwnKeys): number => own[action.name] ?? action.key;

// What a key does: an action that the viewer gave it to; nothing, because its action has another key now; or what the
// session makes of it.
export function meaningOf(
  code: number,
  actions: readonly Action[],
  own: OwnKeys,
): { action: string } | 'nothing' | 'key' {
  for (const action of actions) {
    const given = own[action.name];
    if (given !== undefined && same(given, code)) return { action: action.name };
  }
  const theirs = actions.filter((action) => same(action.key, code));
  if (theirs.length > 0 && theirs.every((action) => own[action.name] !== undefined)) return 'nothing';
  return 'key';
}

// Why an action cannot have a key, or ''.
export function problemOfKey(
  code: number,
  name: string,
  actions: readonly Action[],
  own: OwnKeys,
  reserved: ReadonlySet<number>,
): string {
  if (code === 27) return 'Escape is reserved for the page.';
  for (const other of actions) {
    if (other.name !== name && keyOf(other, own) > 0 && same(keyOf(other, own), code))
      return `${keyName(code)} is already the key of "${other.help || other.name}". Change that key first.`;
  }
  if (reserved.has(code)) return `${keyName(code)} is reserved for the page.`;
  return '';
}

// With the key of an action set; its own key, or null, takes the entry away.
export function withKey(own: OwnKeys, action: Action, code: number | null): OwnKeys {
  const next = { ...own };
  if (code === null || code === action.key) delete next[action.name];
  else next[action.name] = code;
  return next;
}

function load(): Record<string, OwnKeys> {
  try {
    return parseKeys(localStorage.getItem(STORE));
  } catch {
    return {}; // a browser without storage
  }
}

export const ownKeys = signal<Readonly<Record<string, OwnKeys>>>({});

// Reads what this browser has; again when another tab changes it.
export function startKeys(): void {
  ownKeys.value = load();
  window.addEventListener('storage', (event) => {
    if (event.key === STORE) ownKeys.value = load();
  });
}

// False where the browser keeps nothing: the keys hold until the page is closed.
export function setKeys(verb: string, keys: OwnKeys): boolean {
  const all: Record<string, OwnKeys> = { ...ownKeys.value };
  if (Object.keys(keys).length > 0) all[verb] = keys;
  else delete all[verb];
  ownKeys.value = all;
  try {
    localStorage.setItem(STORE, JSON.stringify(all));
    return true;
  } catch {
    return false;
  }
}
