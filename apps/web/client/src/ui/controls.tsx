// Buttons, fields and the like. All are plain HTML with labels.
import type { ComponentChildren, JSX } from 'preact';
import { useEffect, useId, useRef, useState } from 'preact/hooks';
import { numberText, timeText } from '../format';

type ButtonProps = Omit<JSX.IntrinsicElements['button'], 'ref' | 'size' | 'icon'> & {
  kind?: 'plain' | 'main' | 'danger' | 'quiet';
  small?: boolean;
  busy?: boolean;
  children?: ComponentChildren;
};

export function Button({
  kind = 'plain',
  small,
  busy,
  children,
  class: extra,
  disabled,
  ...rest
}: ButtonProps) {
  const words = ['button', `button-${kind}`, small ? 'button-small' : '', busy ? 'is-busy' : '', extra ?? ''];
  return (
    <button
      type="button"
      {...rest}
      class={words.filter((word) => word !== '').join(' ')}
      disabled={disabled === true || busy === true}
      aria-busy={busy ? 'true' : undefined}
    >
      {children}
    </button>
  );
}

// A button that runs a promise and is busy meanwhile.
export function AsyncButton({
  run,
  ...rest
}: Omit<ButtonProps, 'onClick'> & { run: () => Promise<unknown> }) {
  const [busy, setBusy] = useState(false);
  const alive = useRef(true);
  useEffect(() => {
    alive.current = true;
    return () => {
      alive.current = false;
    };
  }, []);
  return (
    <Button
      {...rest}
      busy={busy}
      onClick={() => {
        setBusy(true);
        void run().finally(() => {
          if (alive.current) setBusy(false);
        });
      }}
    />
  );
}

// A label, its control and its help. The child gets the ids that tie them together.
export function Field(props: {
  label: string;
  help?: string;
  problem?: string;
  children: (ids: {
    id: string;
    'aria-describedby': string | undefined;
    'aria-invalid': boolean;
  }) => ComponentChildren;
}) {
  const id = useId();
  const problem = props.problem ?? '';
  const described = [props.help ? `${id}-help` : '', problem ? `${id}-problem` : ''].filter(
    (one) => one !== '',
  );
  return (
    <div class="field">
      <label for={id}>{props.label}</label>
      {props.children({
        id,
        'aria-describedby': described.length > 0 ? described.join(' ') : undefined,
        'aria-invalid': problem !== '',
      })}
      {props.help && (
        <p class="field-help" id={`${id}-help`}>
          {props.help}
        </p>
      )}
      {problem && (
        <p class="field-problem" id={`${id}-problem`} role="alert">
          {problem}
        </p>
      )}
    </div>
  );
}

export function TextField(props: {
  label: string;
  value: string;
  onInput: (value: string) => void;
  help?: string;
  problem?: string;
  suggestions?: string[];
  type?: 'text' | 'search' | 'password' | 'number' | 'date' | 'datetime-local';
  min?: number;
  max?: number;
  step?: number | 'any';
  placeholder?: string;
  required?: boolean;
  autocomplete?: string;
}) {
  const list = useId();
  const suggestions = props.suggestions ?? [];
  const type = (props.type ?? 'text') as 'text'; // one element for all of these types
  return (
    <Field label={props.label} help={props.help} problem={props.problem}>
      {(ids) => (
        <>
          <input
            {...ids}
            type={type}
            value={props.value}
            min={props.min}
            max={props.max}
            step={props.step}
            required={props.required}
            placeholder={props.placeholder}
            autocomplete={props.autocomplete ?? 'off'}
            list={suggestions.length > 0 ? list : undefined}
            onInput={(event) => props.onInput(event.currentTarget.value)}
          />
          {suggestions.length > 0 && (
            <datalist id={list}>
              {suggestions.map((word) => (
                <option key={word} value={word} />
              ))}
            </datalist>
          )}
        </>
      )}
    </Field>
  );
}

export function Select(props: {
  label: string;
  value: string;
  options: { value: string; label: string; group?: string }[];
  onChange: (value: string) => void;
  help?: string;
  problem?: string;
}) {
  const groups = [...new Set(props.options.map((option) => option.group ?? ''))];
  const show = (option: { value: string; label: string }) => (
    <option key={option.value} value={option.value} selected={option.value === props.value}>
      {option.label}
    </option>
  );
  return (
    <Field label={props.label} help={props.help} problem={props.problem}>
      {(ids) => (
        <select {...ids} value={props.value} onChange={(event) => props.onChange(event.currentTarget.value)}>
          {groups.map((group) => {
            const options = props.options.filter((option) => (option.group ?? '') === group).map(show);
            return group === '' ? (
              options
            ) : (
              <optgroup key={group} label={group}>
                {options}
              </optgroup>
            );
          })}
        </select>
      )}
    </Field>
  );
}

export function Checkbox(props: {
  label: string;
  checked: boolean;
  onChange: (checked: boolean) => void;
  help?: string;
}) {
  const id = useId();
  return (
    <div class="field field-check">
      <label for={id}>
        <input
          id={id}
          type="checkbox"
          checked={props.checked}
          aria-describedby={props.help ? `${id}-help` : undefined}
          onChange={(event) => props.onChange(event.currentTarget.checked)}
        />
        <span>{props.label}</span>
      </label>
      {props.help && (
        <p class="field-help" id={`${id}-help`}>
          {props.help}
        </p>
      )}
    </div>
  );
}

// Digits behind the point that tell two steps apart; at most 3.
export function decimalsOf(step: number): number {
  for (let digits = 0; digits < 3; digits += 1) {
    if (Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) < 1e-9) return digits;
  }
  return 3;
}

// A number on a track and as text; onChange while it moves, at most 15 times a second.
export function Slider(props: {
  label: string;
  value: number;
  low: number;
  high: number;
  step?: number;
  help?: string;
  round?: number; // another one: somebody else has moved it
  onChange: (value: number) => void;
}) {
  const id = useId();
  const [own, setOwn] = useState<number | null>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const waiting = useRef<number | null>(null);
  const send = (value: number) => {
    setOwn(value);
    waiting.current = value;
    if (timer.current !== undefined) return;
    const flush = () => {
      timer.current = undefined;
      if (waiting.current === null) return;
      const next = waiting.current;
      waiting.current = null;
      props.onChange(next);
      timer.current = setTimeout(flush, 66);
    };
    flush();
  };
  // The value that comes back counts again a second after the last touch.
  useEffect(() => {
    if (own === null) return;
    const back = setTimeout(() => setOwn(null), 1000);
    return () => clearTimeout(back);
  }, [own]);
  useEffect(() => () => clearTimeout(timer.current), []);
  useEffect(() => {
    setOwn(null);
  }, [props.round]);
  const shown = own ?? props.value;
  const step = props.step && props.step > 0 ? props.step : (props.high - props.low) / 100 || 1;
  return (
    <div class="field slider">
      <label for={id}>{props.label}</label>
      <div class="slider-row">
        <input
          id={id}
          type="range"
          min={props.low}
          max={props.high}
          step={step}
          value={shown}
          aria-describedby={props.help ? `${id}-help` : undefined}
          onInput={(event) => send(Number(event.currentTarget.value))}
        />
        <input
          class="slider-number"
          type="number"
          aria-label={`${props.label}, as a number`}
          min={props.low}
          max={props.high}
          step={step}
          value={numberText(shown, decimalsOf(step))}
          onChange={(event) => {
            const value = Number(event.currentTarget.value);
            if (Number.isFinite(value)) send(Math.min(props.high, Math.max(props.low, value)));
          }}
        />
      </div>
      {props.help && (
        <p class="field-help" id={`${id}-help`}>
          {props.help}
        </p>
      )}
    </div>
  );
}

export function Progress(props: { label: string; done: number; total: number; unit?: string }) {
  const known = props.total > 0;
  const text = known
    ? `${Math.floor((100 * props.done) / props.total)} %${props.total === 100 && !props.unit ? '' : ` (${props.done} of ${props.total}${props.unit ? ` ${props.unit}` : ''})`}`
    : 'working';
  return (
    <div class="progress">
      <span class="progress-label">{props.label}</span>
      <progress
        aria-label={props.label}
        max={known ? props.total : undefined}
        value={known ? props.done : undefined}
      />
      <span class="progress-text">{text}</span>
    </div>
  );
}

// Tabs by the pattern of WAI-ARIA: arrow keys move, the panel follows.
export function Tabs(props: {
  label: string;
  tabs: { id: string; label: string }[];
  value: string;
  onChange: (id: string) => void;
  children: ComponentChildren;
}) {
  const base = useId();
  const row = useRef<HTMLDivElement>(null);
  const move = (event: KeyboardEvent) => {
    const at = props.tabs.findIndex((tab) => tab.id === props.value);
    const last = props.tabs.length - 1;
    let next = -1;
    if (event.key === 'ArrowRight') next = at === last ? 0 : at + 1;
    else if (event.key === 'ArrowLeft') next = at <= 0 ? last : at - 1;
    else if (event.key === 'Home') next = 0;
    else if (event.key === 'End') next = last;
    const tab = props.tabs[next];
    if (!tab) return;
    event.preventDefault();
    props.onChange(tab.id);
    row.current?.querySelectorAll<HTMLButtonElement>('[role=tab]')[next]?.focus();
  };
  return (
    <div class="tabs">
      <div class="tab-row" role="tablist" aria-label={props.label} ref={row} onKeyDown={move}>
        {props.tabs.map((tab) => (
          <button
            key={tab.id}
            type="button"
            role="tab"
            id={`${base}-${tab.id}`}
            aria-controls={`${base}-panel`}
            aria-selected={tab.id === props.value}
            tabIndex={tab.id === props.value ? 0 : -1}
            onClick={() => props.onChange(tab.id)}
          >
            {tab.label}
          </button>
        ))}
      </div>
      <div role="tabpanel" id={`${base}-panel`} aria-labelledby={`${base}-${props.value}`} tabIndex={0}>
        {props.children}
      </div>
    </div>
  );
}

// A modal window of the page; Escape closes it, the focus goes back to where it was.
export function Dialog(props: {
  title: string;
  open: boolean;
  onClose: () => void;
  children: ComponentChildren;
  wide?: boolean;
}) {
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useId();
  useEffect(() => {
    const one = dialog.current;
    if (!one) return;
    if (props.open && !one.open) one.showModal();
    else if (!props.open && one.open) one.close();
  }, [props.open]);
  return (
    <dialog
      ref={dialog}
      class={props.wide ? 'dialog dialog-wide' : 'dialog'}
      aria-labelledby={id}
      onClose={() => {
        if (props.open) props.onClose();
      }}
    >
      {props.open && (
        <>
          <div class="dialog-head">
            <h2 id={id}>{props.title}</h2>
            <Button kind="quiet" small aria-label="Close" onClick={props.onClose}>
              ✕
            </Button>
          </div>
          <div class="dialog-body">{props.children}</div>
        </>
      )}
    </dialog>
  );
}

// Asks before something that cannot be undone.
export function Confirm(props: {
  title: string;
  text: string;
  yes: string;
  open: boolean;
  onYes: () => void;
  onClose: () => void;
}) {
  return (
    <Dialog title={props.title} open={props.open} onClose={props.onClose}>
      <p>{props.text}</p>
      <div class="row row-end">
        <Button onClick={props.onClose}>Cancel</Button>
        <Button kind="danger" onClick={props.onYes}>
          {props.yes}
        </Button>
      </div>
    </Dialog>
  );
}

export interface Column<Row> {
  name: string;
  show: (row: Row) => ComponentChildren;
  number?: boolean;
}

export function Table<Row>(props: {
  caption: string;
  columns: Column<Row>[];
  rows: Row[];
  keyOf: (row: Row, index: number) => string | number;
  empty?: string;
  hideCaption?: boolean;
  stacks?: boolean; // on a phone a row is a card, as those of more than three columns are
}) {
  return (
    <div
      class={`table-box${(props.stacks ?? props.columns.length > 3) ? ' stacks' : ''}${props.columns.length > 6 ? ' is-dense' : ''}`}
      tabIndex={0}
      role="group"
      aria-label={props.caption}
    >
      <table role="table">
        <caption class={props.hideCaption ? 'unseen' : undefined}>{props.caption}</caption>
        <thead role="rowgroup">
          <tr role="row">
            {props.columns.map((column) => (
              <th
                key={column.name}
                scope="col"
                role="columnheader"
                class={column.number ? 'number' : undefined}
              >
                {column.name}
              </th>
            ))}
          </tr>
        </thead>
        <tbody role="rowgroup">
          {props.rows.length === 0 && (
            <tr role="row">
              <td role="cell" colSpan={props.columns.length} class="faint">
                {props.empty ?? 'Nothing here yet.'}
              </td>
            </tr>
          )}
          {props.rows.map((row, index) => (
            <tr key={props.keyOf(row, index)} role="row">
              {props.columns.map((column) => (
                <td
                  key={column.name}
                  role="cell"
                  data-label={column.name}
                  class={column.number ? 'number' : undefined}
                >
                  {column.show(row)}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

// A day and a time of that day, which may be broken between the two alone.
export function Timestamp({ at }: { at: string | number | null | undefined }) {
  const [day, time] = timeText(at).split(' ');
  return (
    <span>
      <span class="nowrap">{day}</span> <span class="nowrap">{time}</span>
    </span>
  );
}

// A command line that can be copied.
export function CommandLine({ text, label = 'Command' }: { text: string; label?: string }) {
  const [said, setSaid] = useState('');
  const box = useRef<HTMLElement>(null);
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text);
      setSaid('Copied');
    } catch {
      // Without https there is no clipboard: the text is selected for Ctrl+C.
      const selection = getSelection();
      if (box.current && selection) selection.selectAllChildren(box.current);
      setSaid('Selected: press Ctrl+C');
    }
    setTimeout(() => setSaid(''), 2500);
  };
  return (
    <div class="command" role="group" aria-label={label}>
      <code ref={box} tabIndex={0}>
        {text}
      </code>
      <Button small onClick={() => void copy()}>
        Copy
      </Button>
      <span class="faint" aria-live="polite">
        {said}
      </span>
    </div>
  );
}

// Files by drop, by click, by keyboard, or from the phone's camera.
export function FileDrop(props: {
  label: string;
  help?: string;
  accept?: string;
  multiple?: boolean;
  onFiles: (files: File[]) => void;
  disabled?: boolean;
}) {
  const id = useId();
  const [over, setOver] = useState(false);
  const give = (list: FileList | null | undefined) => {
    const files = list ? [...list] : [];
    if (files.length > 0 && !props.disabled) props.onFiles(files);
  };
  return (
    <div
      class={over ? 'drop is-over' : 'drop'}
      onDragOver={(event) => {
        event.preventDefault();
        setOver(true);
      }}
      onDragLeave={() => setOver(false)}
      onDrop={(event) => {
        event.preventDefault();
        setOver(false);
        give(event.dataTransfer?.files);
      }}
    >
      <label for={id}>{props.label}</label>
      <input
        id={id}
        type="file"
        accept={props.accept}
        multiple={props.multiple}
        disabled={props.disabled}
        aria-describedby={props.help ? `${id}-help` : undefined}
        onChange={(event) => {
          give(event.currentTarget.files);
          event.currentTarget.value = '';
        }}
      />
      {props.help && (
        <p class="field-help" id={`${id}-help`}>
          {props.help}
        </p>
      )}
    </div>
  );
}

export function EmptyState(props: {
  title: string;
  text: string;
  onSynthetic?: () => Promise<unknown> | void;
  children?: ComponentChildren;
}) {
  return (
    <div class="empty">
      <Eyes />
      <h2>{props.title}</h2>
      <p>{props.text}</p>
      <div class="row row-middle">
        {props.onSynthetic && (
          <AsyncButton kind="main" run={async () => props.onSynthetic?.()}>
            Try with synthetic data
          </AsyncButton>
        )}
        {props.children}
      </div>
    </div>
  );
}

// The program's two eyes; decoration.
export function Eyes() {
  return (
    <svg class="eyes" viewBox="0 0 92 44" aria-hidden="true">
      <circle class="eye" cx="22" cy="22" r="20" />
      <circle class="eye" cx="70" cy="22" r="20" />
      <circle class="pupil" cx="24" cy="23" r="9" />
      <circle class="pupil" cx="68" cy="23" r="9" />
      <circle class="glint" cx="20" cy="18" r="3.5" />
      <circle class="glint" cx="64" cy="18" r="3.5" />
    </svg>
  );
}

export function Notice(props: { kind?: 'info' | 'problem' | 'good'; children: ComponentChildren }) {
  const kind = props.kind ?? 'info';
  return (
    <div class={`notice notice-${kind}`} role={kind === 'problem' ? 'alert' : undefined}>
      {props.children}
    </div>
  );
}

// The page's heading; it takes the focus when the page changes.
export function PageHead(props: { title: string; text?: string; children?: ComponentChildren }) {
  return (
    <div class="page-head">
      <div>
        <h1 tabIndex={-1}>{props.title}</h1>
        {props.text && <p class="lead">{props.text}</p>}
      </div>
      {props.children && <div class="row">{props.children}</div>}
    </div>
  );
}
