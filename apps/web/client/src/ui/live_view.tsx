// The image of a live session on a canvas, with its text beside it.
import { useEffect, useRef, useState } from 'preact/hooks';
import { signal } from '@preact/signals';
import { useSignalValue } from '../hooks';
import { api, type MouseKind, type SessionEvent } from '../api';
import { imagePoint, sessionKey } from '../keys';
import { meaningOf, ownKeys } from '../key_map';
import { liveSession, setImageWidth, watchSession, type Paint } from '../live';
import { WHOLE, widthFor } from '../image_size';
import { toastError } from './toast';

const BUTTONS = ['left', 'middle', 'right'] as const;

// Sends events in order; of mouse moves that wait only the newest is kept, at most 30 a second.
class EventSender {
  private waiting: SessionEvent[] = [];
  private busy = false;
  private last = 0;

  constructor(private readonly id: string) {}

  send(event: SessionEvent): void {
    const before = this.waiting[this.waiting.length - 1];
    const move = 'mouse' in event && event.mouse === 'move';
    if (move && before && 'mouse' in before && before.mouse === 'move') this.waiting.pop();
    this.waiting.push(event);
    void this.flush(move);
  }

  private async flush(move: boolean): Promise<void> {
    if (this.busy) return;
    this.busy = true;
    try {
      const wait = move ? this.last + 33 - performance.now() : 0;
      if (wait > 0) await new Promise((done) => setTimeout(done, wait));
      while (this.waiting.length > 0) {
        const events = this.waiting.splice(0, 64);
        this.last = performance.now();
        await api.sendEvents(this.id, events);
        if (this.waiting.length === 1) {
          const rest = this.last + 33 - performance.now();
          if (rest > 0) await new Promise((done) => setTimeout(done, rest));
        }
      }
    } catch (problem) {
      this.waiting = [];
      toastError(problem);
    } finally {
      this.busy = false;
    }
  }
}

const senders = new Map<string, EventSender>();

// Counts actions and keys: what a slider shows of its own is old then.
export const actionCount = signal(0);

// Sends an action, slider, key or mouse event to a session.
export function sendEvent(id: string, event: SessionEvent): void {
  let sender = senders.get(id);
  if (!sender) senders.set(id, (sender = new EventSender(id)));
  sender.send(event);
  if (!('slider' in event) && !('mouse' in event)) actionCount.value += 1;
}

// The session's status, at most once in so many milliseconds.
function useStatus(id: string, pause: number): string {
  const live = liveSession(id);
  const [status, setStatus] = useState('');
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    const stop = live.state.subscribe((state) => {
      if (!state || timer !== undefined) return;
      setStatus(state.status);
      timer = setTimeout(() => {
        timer = undefined;
        setStatus(live.state.peek()?.status ?? '');
      }, pause);
    });
    return () => {
      stop();
      clearTimeout(timer);
    };
  }, [id, pause]);
  return status;
}

// The session's status line, shown at most five times a second, and read out at most once a second.
export function LiveStatus({ id, quiet }: { id: string; quiet?: boolean }) {
  const shown = useStatus(id, 200);
  const said = useStatus(id, 1000);
  const waiting = 'Waiting for the first image.';
  return (
    <>
      <p class="live-status" aria-hidden="true">
        {shown || waiting}
      </p>
      <p class="unseen" aria-live={quiet ? 'off' : 'polite'}>
        {said || waiting}
      </p>
    </>
  );
}

export interface LiveViewProps {
  id: string;
  title: string; // for those who do not see the image
  interactive?: boolean; // mouse and keys go to the session
  drag?: boolean; // a finger on the image drags points instead of scrolling the page
  moves?: boolean; // mouse moves without a button are sent too
  onCanvas?: (canvas: HTMLCanvasElement | null) => void;
  onMouse?: (kind: MouseKind, x: number, y: number) => void;
  blockedKeys?: ReadonlySet<number>; // keys that stay with the page
  verb?: string; // of the session, for keys that the viewer changed
  whole?: boolean; // images in their full size, however small they are shown
}

export function LiveView(props: LiveViewProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const box = useRef<HTMLDivElement>(null);
  const [has, setHas] = useState(false);
  const live = liveSession(props.id);
  const ended = useSignalValue(live.ended);

  useEffect(() => setHas(false), [props.id]);

  useEffect(() => {
    let first = true;
    const need = () => (props.whole ? WHOLE : widthFor(box.current?.clientWidth ?? 0, devicePixelRatio));
    const paint: Paint = (bitmap) => {
      const one = canvas.current;
      if (!one) return;
      if (one.width !== bitmap.width || one.height !== bitmap.height) {
        one.width = bitmap.width;
        one.height = bitmap.height;
      }
      one.getContext('2d', { alpha: false })?.drawImage(bitmap, 0, 0);
      if (first) {
        first = false;
        setHas(true);
      }
    };
    const stop = watchSession(props.id, paint, need());
    const observer = new ResizeObserver(() => setImageWidth(props.id, paint, need()));
    if (box.current) observer.observe(box.current);
    return () => {
      observer.disconnect();
      stop();
    };
  }, [props.id, props.whole]);

  useEffect(() => {
    props.onCanvas?.(canvas.current);
    return () => props.onCanvas?.(null);
  }, []);

  const interactive = props.interactive === true && ended === undefined;

  const mouse = (kind: MouseKind, event: PointerEvent | WheelEvent | MouseEvent, wheel?: number) => {
    const one = canvas.current;
    if (!one || !has) return;
    const { x, y } = imagePoint(event, one.getBoundingClientRect(), one);
    // The size goes along: an image of another size may be on its way.
    const out: SessionEvent = { mouse: kind, x, y, width: one.width };
    if (event.shiftKey) out.shift = true;
    if (event.ctrlKey) out.control = true;
    if (wheel !== undefined) out.wheel = wheel;
    sendEvent(props.id, out);
    props.onMouse?.(kind, x, y);
  };

  // The wheel is the session's only while the image has the focus: else the page scrolls.
  useEffect(() => {
    const one = canvas.current;
    if (!one || !interactive) return;
    const onWheel = (event: WheelEvent) => {
      if (document.activeElement !== one || event.deltaY === 0) return;
      event.preventDefault();
      mouse('wheel', event, event.deltaY < 0 ? 1 : -1);
    };
    one.addEventListener('wheel', onWheel, { passive: false });
    return () => one.removeEventListener('wheel', onWheel);
  }, [interactive, has, props.id]);

  const handlers = interactive
    ? {
        onPointerDown: (event: PointerEvent) => {
          const button = BUTTONS[event.button];
          if (!button) return;
          canvas.current?.focus({ preventScroll: true });
          canvas.current?.setPointerCapture(event.pointerId);
          mouse(`${button}-down`, event);
        },
        onPointerUp: (event: PointerEvent) => {
          const button = BUTTONS[event.button];
          if (button) mouse(`${button}-up`, event);
        },
        onPointerMove: (event: PointerEvent) => {
          if (event.buttons !== 0 || props.moves !== false) mouse('move', event);
        },
        onDblClick: (event: MouseEvent) => mouse('double', event),
        onContextMenu: (event: MouseEvent) => event.preventDefault(),
        onKeyDown: (event: KeyboardEvent) => {
          const code = sessionKey(event);
          if (code === null || props.blockedKeys?.has(code)) return;
          event.preventDefault();
          const actions = live.hello.peek()?.actions ?? [];
          const meaning = meaningOf(code, actions, ownKeys.peek()[props.verb ?? ''] ?? {});
          if (meaning === 'nothing') return;
          if (meaning !== 'key') {
            sendEvent(props.id, meaning);
            return;
          }
          const out: SessionEvent = { key: code };
          if (event.shiftKey) out.shift = true;
          if (event.ctrlKey) out.control = true;
          sendEvent(props.id, out);
        },
      }
    : {};

  return (
    <div ref={box} class={`live-view${has ? '' : ' is-waiting'}${ended ? ' is-ended' : ''}`}>
      <canvas
        ref={canvas}
        class={props.drag ? 'drags' : undefined}
        width={640}
        height={480}
        role={interactive ? 'application' : 'img'}
        aria-roledescription={interactive ? 'live image' : undefined}
        aria-label={
          interactive
            ? `${props.title}. While it has the focus, keys go to the session. Tab leaves it.`
            : props.title
        }
        tabIndex={interactive ? 0 : undefined}
        {...handlers}
      />
      {!has && !ended && (
        <p class="live-wait" aria-hidden="true">
          Waiting for the first image
        </p>
      )}
      {ended && <p class="live-wait">{ended.error ? `Ended: ${ended.error}` : 'Ended.'}</p>}
    </div>
  );
}
