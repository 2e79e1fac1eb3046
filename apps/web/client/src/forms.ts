// The model of a form made from `tarsier help --json`: which control a flag gets, what it may be, what is
// sent, and the command that would do the same. Pure code.
import type { FlagHelp, Flags, FlagValue, VerbHelp } from './api';

export type Control = 'switch' | 'choice' | 'choices' | 'integer' | 'number' | 'text' | 'list';

export interface Field {
  name: string; // what is sent: "--mode"
  label: string; // "mode"
  control: Control;
  choices: string[];
  suggestions: string[]; // words that a text may be, among other values
  min: number | null;
  minExcluded: boolean;
  maxExcluded: boolean;
  max: number | null;
  values: number;
  default: FlagValue | null;
  required: boolean;
  help: string;
  group: string;
  needs: string[];
  excludes: string[];
}

// What the form holds: text as typed, switches as boolean, several choices as list.
export type FormValue = string | boolean | string[];
export type FormValues = Record<string, FormValue>;

// Flags that make no sense in a browser, or that the server sets itself or refuses.
export const HIDDEN_FLAGS = new Set([
  '--output',
  '--window',
  '--fullscreen',
  '--actions',
  '--save-dir',
  '--wait',
  '--ca-file',
  '--insecure',
  '--segment',
  '--listen-all',
  '--token',
  '--token-file',
  '--debug-dir',
  '--json',
  '--quiet',
  '--log-level',
  '--progress',
  '--config',
  '--timings',
  '--on-event',
  '--on-event-timeout',
]);

// "--min-face": "Min face".
export function labelOf(name: string): string {
  const words = name.replace(/^--/, '').replaceAll('-', ' ');
  return words.charAt(0).toUpperCase() + words.slice(1);
}

export function fieldOf(flag: FlagHelp): Field {
  const name =
    flag.names.find((one) => one.startsWith('--') && !one.startsWith('--no-')) ?? flag.names[0] ?? '';
  const number = flag.type === 'integer' || flag.type === 'number';
  let control: Control = 'text';
  if (flag.type === 'switch') control = 'switch';
  else if (flag.choices.length > 0 && flag.repeatable) control = 'choices';
  else if (flag.choices.length > 0) control = 'choice';
  else if (flag.repeatable || flag.values > 1) control = 'list';
  else if (flag.type === 'integer' || flag.type === 'number') control = flag.type;
  return {
    name,
    label: number && flag.unit ? `${labelOf(name)}, ${flag.unit}` : labelOf(name),
    control,
    choices: flag.choices,
    suggestions: control === 'text' ? flag.suggestions : [],
    min: flag.range?.min ?? null,
    minExcluded: flag.range?.min_excluded ?? false,
    max: flag.range?.max ?? null,
    maxExcluded: flag.range?.max_excluded ?? false,
    values: flag.values,
    default: flag.default,
    required: flag.required,
    help: number && flag.help === flag.unit ? '' : flag.help, // the label says it
    group: flag.group,
    needs: flag.needs,
    excludes: flag.excludes,
  };
}

export interface FieldGroup {
  name: string;
  fields: Field[];
}

export interface FormOptions {
  only?: string[]; // these flags, in this order
  hide?: Iterable<string>;
  allowed?: (name: string) => boolean;
  output?: boolean; // also --output, if a run of the verb needs it
}

// The field of --output, required; undefined if a run of the verb needs none.
function outputField(verb: VerbHelp): Field | undefined {
  const flag = verb.flags.find((one) => one.names.includes('--output'));
  if (!flag || !(flag.required || verb.needs_output?.includes('--output'))) return undefined;
  return { ...fieldOf(flag), required: true, help: `${flag.help}; give out:NAME` };
}

export function formGroups(verb: VerbHelp, options: FormOptions = {}): FieldGroup[] {
  const hidden = new Set([...HIDDEN_FLAGS, ...(options.hide ?? [])]);
  let fields = verb.flags.map(fieldOf);
  if (options.only) {
    const only = options.only;
    fields = only.flatMap((name) => fields.filter((field) => field.name === name));
  } else {
    fields = fields.filter((field) => !hidden.has(field.name));
  }
  const output = options.output ? outputField(verb) : undefined;
  if (output) fields = [output, ...fields.filter((field) => field.name !== output.name)];
  if (options.allowed) fields = fields.filter((field) => options.allowed?.(field.name));
  const groups: FieldGroup[] = [];
  for (const field of fields) {
    let group = groups.find((one) => one.name === field.group);
    if (!group) groups.push((group = { name: field.group, fields: [] }));
    group.fields.push(field);
  }
  return groups;
}

// What the control shows before anybody touched it.
export function initialValue(field: Field): FormValue {
  if (field.control === 'switch') return field.default === true;
  if (field.control === 'choices') return Array.isArray(field.default) ? field.default.map(String) : [];
  if (Array.isArray(field.default)) return field.default.join(' ');
  return field.default === null ? '' : String(field.default);
}

// The value of each field before anybody touched it; `start` replaces defaults.
export function startValues(groups: FieldGroup[], start: Flags = {}): FormValues {
  const values: FormValues = {};
  for (const field of groups.flatMap((group) => group.fields)) {
    const given = start[field.name];
    if (given === undefined) values[field.name] = initialValue(field);
    else if (typeof given === 'boolean') values[field.name] = given;
    else if (Array.isArray(given))
      values[field.name] = field.control === 'choices' ? given.map(String) : given.join(' ');
    else values[field.name] = String(given);
  }
  return values;
}

export function isValid(groups: FieldGroup[], values: FormValues): boolean {
  return groups
    .flatMap((group) => group.fields)
    .every((field) => problemOf(field, values[field.name] ?? initialValue(field)) === '');
}

const split = (text: string) => text.split(/[\s,]+/).filter((word) => word !== '');

// One plain line that says what is wrong, or "".
export function problemOf(field: Field, value: FormValue): string {
  if (typeof value === 'boolean') return '';
  if (Array.isArray(value)) {
    const strange = value.find((word) => !field.choices.includes(word));
    return strange === undefined
      ? ''
      : `${field.label}: ${strange} is not one of ${field.choices.join(', ')}.`;
  }
  const text = value.trim();
  if (text === '') return field.required ? `${field.label} is required.` : '';
  if (field.control === 'choice' && !field.choices.includes(text)) {
    return `${field.label} must be one of ${field.choices.join(', ')}.`;
  }
  if (field.control === 'integer' || field.control === 'number') {
    const number = Number(text);
    if (!Number.isFinite(number)) return `${field.label} must be a number.`;
    if (field.control === 'integer' && !Number.isInteger(number))
      return `${field.label} must be a whole number.`;
    if (field.min !== null && (number < field.min || (field.minExcluded && number === field.min))) {
      return `${field.label} must be ${field.minExcluded ? 'more than' : 'at least'} ${field.min}.`;
    }
    if (field.max !== null && (number > field.max || (field.maxExcluded && number === field.max))) {
      return `${field.label} must be ${field.maxExcluded ? 'less than' : 'at most'} ${field.max}.`;
    }
  }
  if (field.control === 'list' && field.values > 1 && split(text).length !== field.values) {
    return `${field.label} needs ${field.values} values.`;
  }
  return '';
}

// What is sent: only what differs from the default.
export function collectFlags(groups: FieldGroup[], values: FormValues): Flags {
  const flags: Flags = {};
  for (const field of groups.flatMap((group) => group.fields)) {
    const value = values[field.name];
    if (value === undefined) continue;
    const first = initialValue(field);
    if (typeof value === 'boolean') {
      if (value !== first) flags[field.name] = value;
    } else if (Array.isArray(value)) {
      if (value.length > 0 && value.join('\n') !== (Array.isArray(first) ? first.join('\n') : '')) {
        flags[field.name] = value;
      }
    } else {
      const text = value.trim();
      if (text === '' || text === first) continue;
      if (field.control === 'integer' || field.control === 'number') flags[field.name] = Number(text);
      else if (field.control === 'list') flags[field.name] = split(text);
      else flags[field.name] = text;
    }
  }
  return flags;
}

// A sensible step for a number that moves on a slider.
export function stepOf(field: Field): number {
  if (field.control === 'integer') return 1;
  if (field.min === null || field.max === null) return 0.1;
  const span = field.max - field.min;
  return 10 ** Math.floor(Math.log10(span / 50));
}

export function shellWord(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

// The command that does the same in a terminal.
export function commandText(verb: string, inputs: string[], flags: Flags): string {
  const words = ['tarsier', ...verb.split(' '), ...inputs.map(shellWord)];
  for (const [name, value] of Object.entries(flags)) {
    if (value === true) words.push(name);
    else if (value === false) words.push(`--no-${name.replace(/^--/, '')}`);
    else if (Array.isArray(value)) words.push(...value.flatMap((one) => [name, shellWord(String(one))]));
    else if (String(value).startsWith('-')) words.push(`${name}=${shellWord(String(value))}`);
    else words.push(name, shellWord(String(value)));
  }
  return words.join(' ');
}
