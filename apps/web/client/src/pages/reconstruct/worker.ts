// Runs in two places: the page imports it for its address, the worker made of that address does the reading.
import type { Cloud } from './colmap';
import { readGlb, type Surface } from './glb';
import { modelOf, type Model } from './model';
import { readPly } from './ply';

// Where the files are that are to be read.
type Order =
  | { what: 'model'; files: [cameras: string, images: string, points: string] }
  | { what: 'cloud'; files: [ply: string] }
  | { what: 'surface'; files: [glb: string] };
type Result = Model | Cloud | Surface;
type Answer = { result: Result } | { error: string };

const mostPoints = 2_000_000; // of a cloud: more are not worth their memory in a browser

const scope = globalThis as unknown as {
  document?: unknown;
  postMessage(answer: Answer, transfer?: Transferable[]): void;
  onmessage: ((event: MessageEvent<Order>) => void) | null;
};

async function fileAt(address: string): Promise<Response> {
  const response = await fetch(address, { credentials: 'same-origin' });
  if (!response.ok) throw new Error(`The server returned ${response.status} for a file of the model.`);
  return response;
}

async function read(order: Order): Promise<Result> {
  const files = await Promise.all(order.files.map(fileAt));
  if (order.what === 'model') {
    const [cameras, images, points] = await Promise.all(files.map((one) => one.text()));
    return modelOf(cameras!, images!, points!);
  }
  const bytes = new Uint8Array(await files[0]!.arrayBuffer());
  return order.what === 'cloud' ? readPly(bytes, mostPoints) : readGlb(bytes);
}

// The memory of large arrays, which goes to the page without a copy.
function buffersOf(result: Result): Transferable[] {
  const cloud = 'cloud' in result ? result.cloud : result;
  const arrays = [cloud.ids, cloud.positions, cloud.colours, cloud.errors, cloud.trackStart, cloud.tracks];
  return arrays.map((one) => one.buffer as ArrayBuffer);
}

if (scope.document === undefined) {
  scope.onmessage = (event) => {
    read(event.data).then(
      (result) => scope.postMessage({ result }, buffersOf(result)),
      (problem: unknown) =>
        scope.postMessage({ error: problem instanceof Error ? problem.message : String(problem) }),
    );
  };
}

// Reads beside the page. Where there are no workers of modules, in the page.
function readInWorker(order: Order, stop: AbortSignal): Promise<Result> {
  let worker: Worker;
  try {
    worker = new Worker(import.meta.url, { type: 'module' });
  } catch {
    return read(order);
  }
  return new Promise<Result>((resolve, reject) => {
    stop.addEventListener('abort', () => {
      worker.terminate();
      reject(new DOMException('stopped', 'AbortError'));
    });
    worker.onmessage = (event: MessageEvent<Answer>) => {
      worker.terminate();
      if ('result' in event.data) resolve(event.data.result);
      else reject(new Error(event.data.error));
    };
    worker.onerror = () => {
      worker.terminate();
      read(order).then(resolve, reject);
    };
    worker.postMessage({
      ...order,
      files: order.files.map((address) => new URL(address, location.href).href),
    });
  });
}

export const readModel = (cameras: string, images: string, points: string, stop: AbortSignal) =>
  readInWorker({ what: 'model', files: [cameras, images, points] }, stop) as Promise<Model>;
export const readCloud = (ply: string, stop: AbortSignal) =>
  readInWorker({ what: 'cloud', files: [ply] }, stop) as Promise<Cloud>;
export const readSurface = (glb: string, stop: AbortSignal) =>
  readInWorker({ what: 'surface', files: [glb] }, stop) as Promise<Surface>;
