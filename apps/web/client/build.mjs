// Builds the pages into ../dist (or the folder given): hashed names, the same bytes each time.
//   node build.mjs [OUTPUT] [--watch]
import { build, context } from 'esbuild';
import { createHash } from 'node:crypto';
import { copyFileSync, mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const here = dirname(fileURLToPath(import.meta.url));
const words = process.argv.slice(2).filter((word) => !word.startsWith('--'));
const out = resolve(words[0] ?? join(here, '..', 'dist'));
const watch = process.argv.includes('--watch');
const FIRST_LOAD_LIMIT = 120 * 1024;

const options = {
  absWorkingDir: here,
  entryPoints: { studio: 'src/main.tsx', style: 'src/style.css' },
  outdir: join(out, 'assets'),
  bundle: true,
  splitting: true,
  format: 'esm',
  target: ['es2021', 'chrome100', 'firefox100', 'safari15.4'],
  minify: true,
  sourcemap: false,
  legalComments: 'none',
  charset: 'utf8',
  jsx: 'automatic',
  jsxImportSource: 'preact',
  entryNames: '[name]-[hash]',
  chunkNames: '[name]-[hash]',
  assetNames: '[name]-[hash]',
  define: { 'process.env.NODE_ENV': '"production"' },
  metafile: true,
  logLevel: 'warning',
};

function finish(meta) {
  const outputs = Object.entries(meta.outputs).map(([path, info]) => ({
    name: path.slice(path.lastIndexOf('/') + 1),
    path: resolve(here, path),
    info,
  }));
  const entry = (source) => outputs.find((output) => output.info.entryPoint === source);
  const script = entry('src/main.tsx');
  const style = entry('src/style.css');

  // What the first page loads: the entry and all that it imports at once.
  const first = new Set();
  const add = (output) => {
    if (!output || first.has(output)) return;
    first.add(output);
    for (const used of output.info.imports) {
      if (used.kind === 'import-statement') add(outputs.find((one) => one.path === resolve(here, used.path)));
    }
  };
  add(script);
  const preload = [...first]
    .filter((output) => output !== script)
    .map((output) => output.name)
    .sort();

  copyFileSync(join(here, 'src', 'tarsier.svg'), join(out, 'assets', 'tarsier.svg'));
  const icon = readFileSync(join(here, 'src', 'tarsier.svg'));
  const iconName = `tarsier-${createHash('sha256').update(icon).digest('hex').slice(0, 8).toUpperCase()}.svg`;
  rmSync(join(out, 'assets', 'tarsier.svg'));
  writeFileSync(join(out, 'assets', iconName), icon);

  const html = readFileSync(join(here, 'src', 'index.html'), 'utf8')
    .replace('%STYLE%', `/assets/${style.name}`)
    .replace('%SCRIPT%', `/assets/${script.name}`)
    .replace('%ICON%', `/assets/${iconName}`)
    .replace(
      '%PRELOAD%',
      preload.map((name) => `<link rel="modulepreload" href="/assets/${name}" />`).join('\n    '),
    );
  writeFileSync(join(out, 'index.html'), html);
  copyFileSync(join(here, 'LICENSES'), join(out, 'LICENSES.txt'));

  const size = (path) => gzipSync(readFileSync(path), { level: 9 }).length;
  let total = size(join(out, 'index.html')) + size(style.path) + icon.length;
  for (const output of first) total += size(output.path);
  for (const output of outputs.sort((a, b) => a.name.localeCompare(b.name))) {
    const mark = first.has(output) || output === style ? 'first load' : 'on demand';
    console.log(`${String(size(output.path)).padStart(8)} bytes gzip  ${mark}  ${output.name}`);
  }
  console.log(`first load: ${(total / 1024).toFixed(1)} kB gzip, limit ${FIRST_LOAD_LIMIT / 1024} kB`);
  if (total > FIRST_LOAD_LIMIT) {
    console.error('The first load is above its limit.');
    process.exitCode = 1;
  }
}

function clear() {
  rmSync(out, { recursive: true, force: true });
  mkdirSync(join(out, 'assets'), { recursive: true });
}

if (watch) {
  const plugin = {
    name: 'finish',
    setup(build_) {
      build_.onStart(clear);
      build_.onEnd((result) => {
        if (result.metafile) finish(result.metafile);
      });
    },
  };
  const watcher = await context({ ...options, plugins: [plugin] });
  await watcher.watch();
} else {
  clear();
  finish((await build(options)).metafile);
  const files = readdirSync(out, { recursive: true }).length;
  console.log(`${files} files in ${out}`);
}
