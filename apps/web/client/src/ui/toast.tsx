import { signal } from '@preact/signals';
import { errorText } from '../api';
import { Button } from './controls';

interface ToastEntry {
  id: number;
  text: string;
  kind: 'info' | 'problem' | 'good';
}

const toasts = signal<ToastEntry[]>([]);
let last = 0;

const drop = (id: number) => {
  toasts.value = toasts.value.filter((one) => one.id !== id);
};

// A short message at the edge of the page. Problems stay until they are closed.
export function toast(text: string, kind: ToastEntry['kind'] = 'info'): void {
  const id = ++last;
  toasts.value = [...toasts.value.filter((one) => one.text !== text), { id, text, kind }].slice(-4);
  if (kind !== 'problem') setTimeout(() => drop(id), 5000);
}

export function toastError(problem: unknown): void {
  if (problem instanceof DOMException && problem.name === 'AbortError') return;
  toast(errorText(problem), 'problem');
}

// Runs something and shows what went wrong; undefined then.
export async function attempt<T>(run: () => Promise<T>): Promise<T | undefined> {
  try {
    return await run();
  } catch (problem) {
    toastError(problem);
    return undefined;
  }
}

export function Toasts() {
  return (
    <div class="toasts" role="status" aria-live="polite">
      {toasts.value.map((one) => (
        <div key={one.id} class={`toast toast-${one.kind}`}>
          <span>{one.text}</span>
          <Button kind="quiet" small aria-label="Close message" onClick={() => drop(one.id)}>
            ✕
          </Button>
        </div>
      ))}
    </div>
  );
}
