import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { FlagHelp, VerbHelp } from '../src/api';
import {
  collectFlags,
  commandText,
  fieldOf,
  formGroups,
  initialValue,
  isValid,
  problemOf,
  shellWord,
  startValues,
  stepOf,
} from '../src/forms';

const flag = (name: string, more: Partial<FlagHelp> = {}): FlagHelp => ({
  names: [name],
  positional: null,
  type: 'text',
  choices: [],
  suggestions: [],
  headless_value: null,
  range: null,
  default: null,
  values: 1,
  repeatable: false,
  required: false,
  help: '',
  group: 'Options',
  needs: [],
  excludes: [],
  ...more,
});

const MODE = flag('--mode', {
  names: ['-m', '--mode'],
  default: 'cartoon',
  suggestions: ['sketch', 'paint', 'cartoon', 'evil-sketch', 'none'],
  help: 'the style',
});
const PEPPER = flag('--pepper', {
  names: ['--pepper', '--no-pepper'],
  type: 'switch',
  values: 0,
  default: true,
});
const EVERY = flag('--every', {
  type: 'integer',
  default: 1,
  range: { min: 0, max: null, min_excluded: true },
});
const THRESHOLD = flag('--threshold', {
  type: 'integer',
  default: 80,
  range: { min: 0, max: 255, min_excluded: false },
  help: 'of the Laplacian',
  group: 'Lines',
});
const AXES = flag('--axes', { choices: ['x', 'xy'], default: 'x', group: 'Lines' });
const KINDS = flag('--kind', { choices: ['spain', 'us'], repeatable: true });
const PAIR = flag('--distance-between', { values: 2 });
const OUTPUT = flag('--output');
const VERB: VerbHelp = {
  verb: 'cartoon run',
  path: ['cartoon', 'run'],
  area: 'cartoon',
  help: '',
  usage: '',
  example: '',
  inputs: [],
  flags: [OUTPUT, MODE, PEPPER, EVERY, THRESHOLD, AXES, KINDS, PAIR],
};

test('flags become fields with the right control', () => {
  assert.equal(fieldOf(MODE).name, '--mode');
  assert.equal(fieldOf(MODE).control, 'text');
  assert.deepEqual(fieldOf(MODE).suggestions, ['sketch', 'paint', 'cartoon', 'evil-sketch', 'none']);
  assert.equal(fieldOf(PEPPER).control, 'switch');
  assert.equal(fieldOf(EVERY).control, 'integer');
  assert.equal(fieldOf(AXES).control, 'choice');
  assert.equal(fieldOf(KINDS).control, 'choices');
  assert.equal(fieldOf(PAIR).control, 'list');
  const threshold = fieldOf(THRESHOLD);
  assert.deepEqual([threshold.min, threshold.max, stepOf(threshold)], [0, 255, 1]);
  const named = fieldOf(flag('--pairs', { help: 'auto, all; or a file', default: 'auto' }));
  assert.deepEqual(named.suggestions, [], 'no words are read from a help text');
});

test('groups keep their order and omit flags that a browser cannot use', () => {
  const groups = formGroups(VERB);
  assert.deepEqual(
    groups.map((group) => [group.name, group.fields.map((field) => field.name)]),
    [
      ['Options', ['--mode', '--pepper', '--every', '--kind', '--distance-between']],
      ['Lines', ['--threshold', '--axes']],
    ],
  );
  const only = formGroups(VERB, { only: ['--axes', '--mode', '--gone'] });
  assert.deepEqual(
    only.flatMap((group) => group.fields.map((field) => field.name)),
    ['--axes', '--mode'],
  );
  assert.ok(!formGroups(VERB, { hide: ['--mode'] }).some((g) => g.fields.some((f) => f.name === '--mode')));
});

test('a run that needs an output has a required field for it', () => {
  const isRequired = (more: Partial<VerbHelp>, options = { output: true }) => {
    const fields = formGroups({ ...VERB, flags: [OUTPUT, MODE], ...more }, options).flatMap(
      (one) => one.fields,
    );
    return fields.find((field) => field.name === '--output')?.required;
  };
  assert.equal(isRequired({ needs_output: ['--output'] }), true, 'it would open a window');
  assert.equal(isRequired({ needs_output: ['--output', '--grid'] }), true);
  assert.equal(isRequired({ needs_output: [] }), undefined, 'it works only in a window');
  assert.equal(isRequired({ flags: [flag('--output', { required: true })] }), true);
  assert.equal(isRequired({}), undefined);
  assert.equal(
    isRequired({ needs_output: ['--output'] }, { output: false }),
    undefined,
    'live: the page is its window',
  );

  const groups = formGroups({ ...VERB, needs_output: ['--output'] }, { output: true });
  const output = groups[0]!.fields[0]!;
  assert.equal(output.name, '--output');
  assert.match(problemOf(output, ''), /Output is required/);
  assert.equal(isValid(groups, startValues(groups)), false);
  const values = startValues(groups, { '--output': 'out:a.png', '--kind': ['us'] });
  assert.equal(isValid(groups, values), true);
  assert.deepEqual(values['--kind'], ['us']);
  assert.equal(collectFlags(groups, values)['--output'], 'out:a.png');
});

test('invalid values give an error message', () => {
  const every = fieldOf(EVERY);
  assert.equal(problemOf(every, '2'), '');
  assert.equal(problemOf(every, ''), '');
  assert.match(problemOf(every, '0'), /more than 0/);
  assert.match(problemOf(every, '1.5'), /whole number/);
  assert.match(problemOf(every, 'x'), /number/);
  assert.match(problemOf(fieldOf(THRESHOLD), '256'), /at most 255/);
  assert.match(problemOf(fieldOf(AXES), 'z'), /one of x, xy/);
  assert.match(problemOf(fieldOf(PAIR), '1'), /2 values/);
  assert.match(problemOf(fieldOf(flag('--size', { required: true })), ' '), /required/);
  assert.match(problemOf(fieldOf(KINDS), ['moon']), /moon/);
});

test('only what differs from the default is sent', () => {
  const groups = formGroups(VERB);
  const values = Object.fromEntries(
    groups.flatMap((group) => group.fields.map((one) => [one.name, initialValue(one)])),
  );
  assert.deepEqual(collectFlags(groups, values), {});
  assert.deepEqual(
    collectFlags(groups, {
      ...values,
      '--mode': 'sketch',
      '--pepper': false,
      '--every': '3',
      '--threshold': '80',
      '--kind': ['us'],
      '--distance-between': 'a.jpg, b.jpg',
    }),
    {
      '--mode': 'sketch',
      '--pepper': false,
      '--every': 3,
      '--kind': ['us'],
      '--distance-between': ['a.jpg', 'b.jpg'],
    },
  );
});

test('commands are quoted for a shell', () => {
  assert.equal(shellWord("it's here"), `'it'\\''s here'`);
  assert.equal(shellWord('$(rm x)'), `'$(rm x)'`);
  assert.equal(
    commandText('cartoon run', ['synth:portrait?live=1'], {
      '--mode': 'sketch',
      '--steady': true,
      '--pepper': false,
      '--n': '-3',
    }),
    "tarsier cartoon run 'synth:portrait?live=1' --mode sketch --steady --no-pepper --n=-3",
  );
});
