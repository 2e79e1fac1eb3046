// A form made from the flags of a verb.
import type { ComponentChildren } from 'preact';
import { useMemo, useState } from 'preact/hooks';
import type { Flags, VerbHelp } from '../api';
import {
  collectFlags,
  commandText,
  formGroups,
  initialValue,
  isValid,
  problemOf,
  startValues,
  stepOf,
  type Field,
  type FormOptions,
  type FormValue,
  type FormValues,
} from '../forms';
import { AsyncButton, Checkbox, CommandLine, Select, Slider, TextField } from './controls';

function FlagControl({
  field,
  value,
  onChange,
}: {
  field: Field;
  value: FormValue;
  onChange: (value: FormValue) => void;
}) {
  const problem = problemOf(field, value);
  const help = field.help;
  if (field.control === 'switch') {
    return <Checkbox label={field.label} help={help} checked={value === true} onChange={onChange} />;
  }
  if (field.control === 'choice' || field.suggestions.length > 0) {
    const words =
      field.control === 'choice' ? field.choices : [...new Set([...field.suggestions, String(value)])];
    const options = words.map((choice) => ({ value: choice, label: choice }));
    if (!field.required && field.default === null) options.unshift({ value: '', label: '(default)' });
    return (
      <Select
        label={field.label}
        help={help}
        value={String(value)}
        options={options}
        onChange={onChange}
        problem={problem}
      />
    );
  }
  if (field.control === 'choices') {
    const chosen = Array.isArray(value) ? value : [];
    return (
      <fieldset class="field">
        <legend>{field.label}</legend>
        {field.choices.map((choice) => (
          <Checkbox
            key={choice}
            label={choice}
            checked={chosen.includes(choice)}
            onChange={(on) => onChange(on ? [...chosen, choice] : chosen.filter((one) => one !== choice))}
          />
        ))}
        <p class="field-help">{help}</p>
      </fieldset>
    );
  }
  const number = field.control === 'integer' || field.control === 'number';
  if (
    number &&
    field.min !== null &&
    field.max !== null &&
    field.max - field.min <= 1000 &&
    field.default !== null
  ) {
    return (
      <Slider
        label={field.label}
        help={help}
        value={Number(value) || 0}
        low={field.min}
        high={field.max}
        step={stepOf(field)}
        onChange={(next) => onChange(String(next))}
      />
    );
  }
  return (
    <TextField
      label={field.label}
      help={help}
      value={String(value)}
      problem={problem}
      type={number ? 'number' : 'text'}
      required={field.required}
      step={field.control === 'integer' ? 1 : number ? 'any' : undefined}
      min={field.min ?? undefined}
      max={field.max ?? undefined}
      onInput={onChange}
    />
  );
}

// The fields of a verb, group by group; the first group is open.
// `onChange` gets the flags that differ from their defaults, and whether all are valid.
export function FlagFields(props: {
  verb: VerbHelp;
  options?: FormOptions;
  start?: Flags;
  onChange: (flags: Flags, valid: boolean) => void;
}) {
  const groups = useMemo(() => formGroups(props.verb, props.options), [props.verb]);
  const [values, setValues] = useState<FormValues>(() => startValues(groups, props.start));
  const set = (name: string, value: FormValue) => {
    const next = { ...values, [name]: value };
    setValues(next);
    props.onChange(collectFlags(groups, next), isValid(groups, next));
  };
  return (
    <div class="flag-groups">
      {groups.map((group, index) => (
        <details key={group.name} open={index === 0}>
          <summary>{group.name}</summary>
          <div class="fields">
            {group.fields.map((field) => (
              <FlagControl
                key={field.name}
                field={field}
                value={values[field.name] ?? initialValue(field)}
                onChange={(value) => set(field.name, value)}
              />
            ))}
          </div>
        </details>
      ))}
    </div>
  );
}

// The whole form of a verb: what comes before (sources, files) as children, its flags, the command, the button.
export function VerbForm(props: {
  verb: VerbHelp;
  inputs: string[];
  options?: FormOptions;
  start?: Flags;
  submit: string;
  ready?: boolean;
  onSubmit: (flags: Flags) => Promise<unknown>;
  children?: ComponentChildren;
}) {
  const [flags, setFlags] = useState<Flags>(props.start ?? {});
  const [valid, setValid] = useState(() => {
    const groups = formGroups(props.verb, props.options);
    return isValid(groups, startValues(groups, props.start));
  });
  const missing = props.verb.inputs.some((input) => input.required) && props.inputs.length === 0;
  return (
    <form
      class="verb-form"
      onSubmit={(event) => {
        event.preventDefault();
      }}
    >
      {props.children}
      <FlagFields
        verb={props.verb}
        options={props.options}
        start={props.start}
        onChange={(next, good) => {
          setFlags(next);
          setValid(good);
        }}
      />
      <CommandLine text={commandText(props.verb.verb, props.inputs, flags)} label="The same in a terminal" />
      <div class="row row-end">
        <AsyncButton
          kind="main"
          disabled={!valid || missing || props.ready === false}
          run={() => props.onSubmit(flags)}
        >
          {props.submit}
        </AsyncButton>
      </div>
    </form>
  );
}
