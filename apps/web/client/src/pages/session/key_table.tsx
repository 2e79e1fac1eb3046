// The keys of a session's actions, which the viewer may change.
import { useLayoutEffect, useRef, useState } from 'preact/hooks';
import type { Action } from '../../api';
import { actionTitle } from '../../format';
import { useSignalValue } from '../../hooks';
import { keyOf, ownKeys, problemOfKey, setKeys, withKey, type OwnKeys } from '../../key_map';
import { keyName, sessionKey } from '../../keys';
import { Button, Notice, Table } from '../../ui';

// The viewer's keys of a verb, as they change.
export function useOwnKeys(verb: string): OwnKeys {
  return useSignalValue(ownKeys)[verb] ?? {};
}

export function KeyTable(props: { verb: string; actions: Action[]; reserved: ReadonlySet<number> }) {
  const own = useOwnKeys(props.verb);
  const [waiting, setWaiting] = useState<string | null>(null);
  const [said, setSaid] = useState('');
  const [problem, setProblem] = useState('');
  const button = useRef<HTMLButtonElement | null>(null);
  // Where the focus goes elsewhere nobody is going to press a key.
  // At once, so that no key is pressed before it.
  useLayoutEffect(() => {
    if (waiting !== null) button.current?.focus();
  }, [waiting]);
  const keep = (next: OwnKeys, what: string) => {
    setProblem('');
    setSaid(
      setKeys(props.verb, next)
        ? what
        : `${what} This browser stores no settings: the change is lost when the page is closed.`,
    );
  };
  const press = (action: Action, event: KeyboardEvent) => {
    if (waiting !== action.name) return;
    if (['Shift', 'Control', 'Alt', 'Meta', 'Tab'].includes(event.key)) return;
    event.preventDefault();
    event.stopPropagation();
    if (event.key === 'Escape') {
      setWaiting(null);
      setSaid('Nothing was changed.');
      return;
    }
    const code = sessionKey(event);
    if (code === null || keyName(code) === '') {
      setProblem(
        'This key cannot be used. Use a letter, a digit, a symbol, an arrow key, Space, Enter or Delete.',
      );
      return;
    }
    const error = problemOfKey(code, action.name, props.actions, own, props.reserved);
    if (error) {
      setProblem(error);
      return;
    }
    setWaiting(null);
    keep(withKey(own, action, code), `${keyName(code)} is now the key of "${action.help || action.name}".`);
  };
  const changed = props.actions.filter((action) => own[action.name] !== undefined);
  return (
    <div class="stack keys">
      <p class="field-help">
        Select a key, then press its replacement. The keys are stored in this browser for all sessions of "
        {props.verb}".
      </p>
      {problem && <Notice kind="problem">{problem}</Notice>}
      <p aria-live="polite" class={said ? undefined : 'unseen'}>
        {said}
      </p>
      <Table
        caption="Keys of the actions"
        hideCaption
        columns={[
          { name: 'Action', show: (action: Action) => actionTitle(action) },
          {
            name: 'Key',
            show: (action) => {
              const name = keyName(keyOf(action, own)) || 'none';
              const isWaiting = waiting === action.name;
              return (
                <span class="row">
                  <button
                    type="button"
                    class={`button button-plain button-small key-button${isWaiting ? ' is-waiting' : ''}`}
                    data-key-of={action.name}
                    ref={(one) => {
                      if (isWaiting) button.current = one;
                    }}
                    aria-label={
                      isWaiting
                        ? `Press a key for ${action.help || action.name}; Escape cancels`
                        : `Key of ${action.help || action.name}: ${name}. Change it`
                    }
                    onClick={() => {
                      setProblem('');
                      setSaid('');
                      setWaiting(isWaiting ? null : action.name);
                    }}
                    onKeyDown={(event) => press(action, event)}
                    onBlur={() => setWaiting((now) => (now === action.name ? null : now))}
                  >
                    {isWaiting ? 'Press a key' : <kbd>{name}</kbd>}
                  </button>
                  {own[action.name] !== undefined && (
                    <Button
                      small
                      kind="quiet"
                      aria-label={`Reset to ${keyName(action.key) || 'no key'}: ${action.help || action.name}`}
                      onClick={() => {
                        const error = problemOfKey(action.key, action.name, props.actions, own, new Set());
                        if (action.key > 0 && error) setProblem(error);
                        else keep(withKey(own, action, null), 'The default key was restored.');
                      }}
                    >
                      Reset
                    </Button>
                  )}
                </span>
              );
            },
          },
        ]}
        rows={props.actions}
        keyOf={(action) => action.name}
        empty="This session has no actions."
      />
      <div class="row">
        <Button
          small
          disabled={changed.length === 0}
          onClick={() => keep({}, 'All default keys were restored.')}
        >
          Reset all keys
        </Button>
      </div>
    </div>
  );
}
