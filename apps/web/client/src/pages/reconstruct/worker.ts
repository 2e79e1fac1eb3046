// Runs in two places: the page imports it for its address, the worker made of that address does the reading.
import { modelOf, type Model } from './model';

interface Order {
  cameras: string;
  images: string;
  points: string;
}
type Answer = { model: Model } | { error: string };

const scope = globalThis as unknown as {
  document?: unknown;
  postMessage(answer: Answer, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<Order>) => void) | null;
};

async function textAt(address: string): Promise<string> {
  const response = await fetch(address, { credentials: 'same-origin' });
  if (!response.ok) throw new Error(`The server answered ${response.status} for a file of the model.`);
  return response.text();
}

async function read(order: Order): Promise<Model> {
  const [cameras, images, points] = await Promise.all([
    textAt(order.cameras),
    textAt(order.images),
    textAt(order.points),
  ]);
  return modelOf(cameras, images, points);
}

if (scope.document === undefined) {
  scope.onmessage = (event) => {
    read(event.data).then(
      (model) => {
        const c = model.cloud;
        scope.postMessage({ model }, [
          c.ids.buffer,
          c.positions.buffer,
          c.colours.buffer,
          c.errors.buffer,
          c.trackStart.buffer,
          c.tracks.buffer,
        ] as Transferable[]);
      },
      (problem: unknown) =>
        scope.postMessage({ error: problem instanceof Error ? problem.message : String(problem) }),
    );
  };
}

// Reads a model beside the page. Where there are no workers of modules, in the page.
export function readModel(order: Order, stop: AbortSignal): Promise<Model> {
  let worker: Worker;
  try {
    worker = new Worker(import.meta.url, { type: 'module' });
  } catch {
    return read(order);
  }
  return new Promise<Model>((resolve, reject) => {
    stop.addEventListener('abort', () => {
      worker.terminate();
      reject(new DOMException('stopped', 'AbortError'));
    });
    worker.onmessage = (event: MessageEvent<Answer>) => {
      worker.terminate();
      if ('model' in event.data) resolve(event.data.model);
      else reject(new Error(event.data.error));
    };
    worker.onerror = () => {
      worker.terminate();
      read(order).then(resolve, reject);
    };
    const whole = (address: string) => new URL(address, location.href).href;
    worker.postMessage({
      cameras: whole(order.cameras),
      images: whole(order.images),
      points: whole(order.points),
    });
  });
}
