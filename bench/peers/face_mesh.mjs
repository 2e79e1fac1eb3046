// SPDX-License-Identifier: MIT
// node face_mesh.mjs PACKAGE plain|attention IMAGE ..
// Runs MediaPipe's face mesh, the npm package @mediapipe/face_mesh that lies in the folder PACKAGE with its weights, on images that
// a browser reads, each by itself (no tracking), in a headless Chromium ($CHROMIUM, chromium): the package runs nowhere else.
// plain: 468 points; attention: the network that refines eyes and lips (478). Prints for each image a line {"image", "points":
// [[x, y] ..], "ms"}, without points where there is no face. Pixels are counted from the middle of the first, as everywhere in
// Tarsier. Times are by the clock, one image after the other, with the face's detector.
import { spawn } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join, resolve } from 'node:path';

const [folder, kind, ...images] = process.argv.slice(2);
if (!folder || (kind !== 'plain' && kind !== 'attention') || images.length === 0) {
  console.error('usage: node face_mesh.mjs PACKAGE plain|attention IMAGE ..');
  process.exit(2);
}

const page = `<!doctype html><meta charset="utf-8"><script src="/package/face_mesh.js"></script><script>
const say = (what) => fetch('/said', { method: 'POST', body: JSON.stringify(what) });
addEventListener('error', (event) => say({ error: String(event.message) }));
addEventListener('unhandledrejection', (event) => say({ error: String(event.reason) }));
(async () => {
  const mesh = new FaceMesh({ locateFile: (name) => '/package/' + name });
  mesh.setOptions({ staticImageMode: true, maxNumFaces: 1, refineLandmarks: ${kind === 'attention'}, minDetectionConfidence: 0.5 });
  let found;
  mesh.onResults((results) => { found = results.multiFaceLandmarks; });
  for (let k = 0; k < ${images.length}; ++k) {
    const image = new Image();
    image.src = '/image/' + k;
    await image.decode();
    const { naturalWidth: width, naturalHeight: height } = image;
    // The first one loads the networks; so it is not timed.
    if (k === 0) await mesh.send({ image });
    found = undefined;
    const begin = performance.now();
    await mesh.send({ image });
    const ms = performance.now() - begin;
    const points = found && found[0] && found[0].map(({ x, y }) => [x * width - 0.5, y * height - 0.5]);
    await say({ k, points, ms });
  }
  await say({ done: true });
})();
</script>`;

const kinds = { '.js': 'text/javascript', '.wasm': 'application/wasm', '.html': 'text/html' };
const profile = mkdtempSync(join(tmpdir(), 'face-mesh-'));
let browser;
let patience;

function end(status) {
  clearTimeout(patience);
  browser?.once('exit', () => {
    rmSync(profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 200 });
    process.exit(status);
  });
  browser?.kill();
}

// A browser that says nothing for two minutes has failed.
function wait() {
  clearTimeout(patience);
  patience = setTimeout(() => {
    console.error('face_mesh.mjs: the browser said nothing for two minutes');
    end(1);
  }, 120000);
}

for (const signal of ['SIGINT', 'SIGTERM']) process.on(signal, () => end(1));

function hear(body) {
  const said = JSON.parse(body);
  wait();
  if (said.error) {
    console.error(`face_mesh.mjs: ${said.error}`);
    end(1);
  } else if (said.done) {
    end(0);
  } else {
    process.stdout.write(`${JSON.stringify({ image: images[said.k], points: said.points, ms: said.ms })}\n`);
  }
}

const server = createServer((request, answer) => {
  const { pathname } = new URL(request.url, 'http://localhost');
  if (pathname === '/said') {
    const parts = [];
    request.on('data', (part) => parts.push(part)).on('end', () => {
      answer.end();
      hear(Buffer.concat(parts).toString());
    });
    return;
  }
  const file = /^\/package\/([\w.]+)$/.exec(pathname);
  const image = /^\/image\/(\d+)$/.exec(pathname);
  let bytes;
  if (pathname === '/') bytes = Buffer.from(page);
  else if (file) bytes = readFileSync(join(resolve(folder), file[1]));
  else if (image) bytes = readFileSync(images[Number(image[1])]);
  answer.writeHead(bytes ? 200 : 404, { 'Content-Type': pathname === '/' ? 'text/html' : kinds[extname(pathname)] ?? 'application/octet-stream' });
  answer.end(bytes);
});
server.listen(0, '127.0.0.1', () => {
  const flags = ['--headless=new', `--user-data-dir=${profile}`, '--no-first-run', '--disable-background-networking', '--disable-component-update',
    '--disable-sync', '--disable-dev-shm-usage', '--enable-unsafe-swiftshader', '--use-angle=swiftshader'];
  if (process.getuid() === 0) flags.push('--no-sandbox');
  browser = spawn(process.env.CHROMIUM || 'chromium', [...flags, `http://127.0.0.1:${server.address().port}/`], { stdio: 'ignore' });
  browser.on('error', (error) => {
    console.error(`face_mesh.mjs: ${error.message}: apt-get install chromium`);
    process.exit(1);
  });
  wait();
});
