import assert from 'node:assert/strict';
import { test } from 'node:test';
import { moveCursor, pointName, stateOf, tabsTo } from '../src/pages/annotate/model';
import { cameraRows, squareProblem, viewOf, type CameraLine } from '../src/pages/calibrate/model';
import {
  adviceFor,
  correctionOf,
  correctionText,
  drawnFaceOf,
  groupOf,
  nameProblem,
  identifiedFacesOf,
  personOf,
  proofOf,
  enrolResultOf,
} from '../src/pages/people/model';
import {
  areHours,
  cleanPattern,
  cleanText,
  eventOf,
  flagsOf,
  histogram,
  confidenceLevel,
  textOf,
  watchEntryOf,
  whenText,
} from '../src/pages/plates/model';
import {
  boundsOf,
  centreOf,
  observationsOf,
  parseCameras,
  parseImages,
  parsePoints,
  project,
  rotationOf,
} from '../src/pages/reconstruct/colmap';
import { boxText, frusta, modelOf, upOf } from '../src/pages/reconstruct/model';
import {
  eyeOf,
  keyed,
  lengthText,
  moved,
  nearer,
  pick,
  rotate,
  turned,
  upright,
} from '../src/pages/reconstruct/orbit';
import { readPly, writePly } from '../src/pages/reconstruct/ply';
import { addressOf, cleanName, fileName, setName, uploadAll } from '../src/pages/shared/files';
import { problemOfSession, quitSession } from '../src/pages/shared/sessions';
import {
  addSample,
  compare,
  parseCsv,
  polyline,
  progressSeries,
  seriesOf,
  worstFirst,
} from '../src/pages/train/curves';
import {
  caseCell,
  caseColumns,
  caseLabel,
  dataOfJob,
  synthRequest,
  evalRequest,
  evalVerbs,
  trainRequest,
  trainVerbs,
  metricLabel,
} from '../src/pages/train/verbs';

const near = (a: number, b: number, within = 1e-6) =>
  assert.ok(Math.abs(a - b) <= within, `${a} is not ${b}`);

const cameras =
  '# a comment\n1 OPENCV 640 480 600 610 320 240 0.01 -0.02 0.001 0.002\r\n2 PINHOLE 100 50 80 80 50 25\nbroken\n';
const images = [
  '# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME',
  '# POINTS2D[] as (X, Y, POINT3D_ID)',
  '1 1 0 0 0 0 0 0 1 a b.jpg',
  '10.5 20.5 7 320 240 9',
  '2 0.70710678 0 0.70710678 0 1 2 3 2 b.jpg',
  '',
  '3 1 0 0 0 0 0 2 2 c.jpg',
].join('\n');
const points = ['# POINT3D_ID', '9 0 0 5 255 10 20 0.5 1 1 3 0', '12 1 2 4 1 2 3 0.25', 'x', ''].join('\n');

test('cameras of a text model; malformed lines are counted', () => {
  const { value, skipped } = parseCameras(cameras);
  assert.equal(value.size, 2);
  assert.equal(skipped, 1);
  assert.deepEqual(value.get(2)?.params, [80, 80, 50, 25]);
});

test('images: names with spaces, empty lines of features, a last one without its line', () => {
  const { value, skipped } = parseImages(images);
  assert.equal(skipped, 0);
  assert.deepEqual(
    [...value.values()].map((one) => one.name),
    ['a b.jpg', 'b.jpg', 'c.jpg'],
  );
  assert.deepEqual([...value.get(1)!.xy], [10.5, 20.5, 320, 240]);
  assert.equal(value.get(2)!.xy.length, 0);
});

test('points with their tracks', () => {
  const { value, skipped } = parsePoints(points);
  assert.equal(value.count, 2);
  assert.equal(skipped, 1);
  assert.deepEqual([...value.positions], [0, 0, 5, 1, 2, 4]);
  assert.deepEqual([...value.colours], [255, 10, 20, 1, 2, 3]);
  assert.deepEqual([...value.trackStart], [0, 4, 4]);
  assert.deepEqual([...value.tracks], [1, 1, 3, 0]);
});

test('a hundred thousand points are read within two seconds', () => {
  const lines: string[] = [];
  for (let i = 0; i < 100_000; i++)
    lines.push(`${i + 1} ${i % 97}.5 ${i % 89}.25 3.125 10 20 30 0.5 1 ${i} 2 ${i} 3 ${i}`);
  const begin = performance.now();
  const { value } = parsePoints(lines.join('\n'));
  assert.equal(value.count, 100_000);
  assert.equal(value.tracks.length, 600_000);
  assert.ok(performance.now() - begin < 2000);
});

test('projection: principal point, behind the camera, unknown lenses', () => {
  const model = modelOf(cameras, images, points);
  const one = model.cameras.get(1)!;
  const here = model.images.get(1)!;
  assert.deepEqual(project(one, here, [0, 0, 5]), [320, 240]);
  assert.equal(project(one, here, [0, 0, -5]), null);
  assert.equal(project({ ...one, model: 'FOV' }, here, [0, 0, 5]), null);
  // By hand: x = 0.2, y = 0.1, rr = 0.05.
  const rr = 0.05;
  const radial = 1 + 0.01 * rr - 0.02 * rr * rr;
  const u = 0.2 * radial + 2 * 0.001 * 0.02 + 0.002 * (rr + 2 * 0.04);
  const v = 0.1 * radial + 0.001 * (rr + 2 * 0.01) + 2 * 0.002 * 0.02;
  const [x, y] = project(one, here, [1, 0.5, 5])!;
  near(x, 600 * u + 320);
  near(y, 610 * v + 240);
});

test('observations of a point, largest error first; missing features are omitted', () => {
  const model = modelOf(cameras, images, points);
  const seen = observationsOf(0, model.cloud, model.images, model.cameras);
  assert.equal(seen.length, 1); // image 3 has no features
  assert.deepEqual(seen[0]!.seen, [320, 240]);
  near(seen[0]!.error!, 0);
  assert.equal(observationsOf(1, model.cloud, model.images, model.cameras).length, 0);
});

test('where a camera stood, and which way is up', () => {
  const model = modelOf(cameras, images, points);
  const b = model.images.get(2)!;
  const r = rotationOf(b.q);
  const c = centreOf(b);
  for (let i = 0; i < 3; i++)
    near(r[3 * i]! * c[0] + r[3 * i + 1]! * c[1] + r[3 * i + 2]! * c[2] + b.t[i]!, 0);
  const up = upOf(model.images.values());
  assert.ok(up[1] < 0); // y goes down in images
  const turn = upright(up);
  const straight = rotate(turn, up);
  near(straight[0], 0);
  near(straight[2], 0);
  assert.ok(straight[1] > 0);
  assert.deepEqual(upright([0, 0, 0]), [1, 0, 0, 0, 1, 0, 0, 0, 1]);
});

test('frusta: the number of lines for each camera; bounds exclude outliers', () => {
  const model = modelOf(cameras, images, points);
  const { lines, names } = frusta(model, 0.1);
  assert.equal(names.length, 3);
  assert.equal(lines.length, 3 * 20 * 3);
  const spread = new Float32Array(300);
  for (let i = 0; i < 100; i++) spread[3 * i] = i === 99 ? 1e6 : i / 100;
  assert.ok(boundsOf(spread).radius < 1);
  assert.deepEqual(boundsOf(new Float32Array(0)), { centre: [0, 0, 0], radius: 1 });
  assert.equal(boxText(new Float32Array([0, 0, 0, 1, 2, 4])), '1.00 x 2.00 x 4.00');
});

test('keys rotate, pan and zoom the view within limits', () => {
  const orbit = { target: [0, 0, 0] as [number, number, number], distance: 2, yaw: 0, pitch: 0 };
  assert.deepEqual(eyeOf(orbit), [0, 0, 2]);
  assert.ok(turned(orbit, 0, 10).pitch < Math.PI / 2);
  near(nearer(orbit, 1e-9, 1).distance, 1 / 500);
  near(nearer(orbit, 1e9, 1).distance, 50);
  const right = moved(orbit, 0.5, 0, Math.PI / 2);
  near(right.target[0], 2);
  assert.equal(keyed(orbit, 'a', false, 1, 1), null);
  assert.ok(keyed(orbit, 'ArrowLeft', false, 1, 1)!.yaw < 0);
  assert.ok(keyed(orbit, 'ArrowUp', true, 1, 1)!.target[1] > 0);
});

test('a click finds the nearest of the points under it', () => {
  const matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0]; // w = z
  const cloud = new Float32Array([0, 0, 5, 0, 0, 2, 1, 0, 2, 0, 0, -1]);
  assert.equal(pick(cloud, matrix, 100, 100, 50, 50, 9), 1);
  assert.equal(pick(cloud, matrix, 100, 100, 75, 50, 9), 2);
  assert.equal(pick(cloud, matrix, 100, 100, 10, 90, 9), -1);
  assert.equal(lengthText(2, null, 'm'), '2.000 units of the model');
  assert.equal(lengthText(2, 1.5, 'm'), '3.000 m');
});

test('PLY: round trip, ascii, malformed files', () => {
  const { cloud } = modelOf(cameras, images, points);
  const back = readPly(writePly(cloud, (i) => i === 1, 2));
  assert.equal(back.count, 1);
  assert.deepEqual([...back.positions], [2, 4, 8]);
  assert.deepEqual([...back.colours], [1, 2, 3]);
  const text = new TextEncoder();
  const ascii =
    'ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n4 5 6\n';
  assert.deepEqual([...readPly(text.encode(ascii)).positions], [1, 2, 3, 4, 5, 6]);
  assert.throws(() => readPly(text.encode('plx')), /not a PLY/);
  assert.throws(() => readPly(writePly(cloud).subarray(0, 200)), /truncated|not a PLY/);
  assert.throws(() => readPly(text.encode(ascii.replace('ascii', 'binary_big_endian'))), /neither/);
});

test('events of the log by hour, by day where they span days', () => {
  const line = {
    id: 1,
    text: '2471KFD',
    confidence: 0.9,
    first_time: '2026-05-01T12:10:00Z',
    last_time: 'x',
    readings: null,
  };
  assert.equal(eventOf(line)?.text, '2471KFD');
  assert.deepEqual(eventOf(line)?.readings, []);
  assert.equal(eventOf({ text: 'no id' }), null);
  const { bars, step } = histogram(
    ['2026-05-01T12:10:00Z', '2026-05-01T12:59:00Z', '2026-05-01T14:00:00Z', 'bad'],
    0,
  );
  assert.equal(step, 3600_000);
  assert.deepEqual(
    bars.map((one) => one.count),
    [2, 0, 1],
  );
  const days = histogram(['2026-05-01T23:30:00Z', '2026-05-09T01:00:00Z'], 120);
  assert.equal(days.step, 86400_000);
  assert.equal(days.bars.length, 8); // 2 May (local) to 9 May
  assert.equal(histogram(['2020-01-01T00:00:00Z', '2026-05-09T01:00:00Z'], 0).bars.length, 100);
  assert.deepEqual(histogram([], 0).bars, []);
});

test('a search becomes the flags of plate log', () => {
  assert.deepEqual(flagsOf({ text: ' 71k ', near: false, since: '', limit: 9 }), {
    '--limit': 9,
    '--text': '*71K*',
  });
  assert.deepEqual(flagsOf({ text: '24*K?D', near: true, since: '1h', limit: 9 }), {
    '--limit': 9,
    '--text': '24*K?D',
    '--since': '1h',
  });
  assert.deepEqual(flagsOf({ text: '2471KFD', near: true, since: '', limit: 9 }), {
    '--limit': 9,
    '--text': '2471KFD',
    '--near': true,
  });
  assert.equal(cleanText(' rk-082 al '), 'RK082AL');
  assert.equal(cleanText('<img onerror=1>'), 'IMGONERROR1');
  assert.equal(cleanText('--'), null);
  assert.equal(cleanPattern(' b-12?4* '), 'B12?4*');
  assert.equal(cleanPattern('é'), null);
  const read = eventOf({ id: 1, text: '1234BCO', correction: null })!;
  assert.equal(textOf(read), '1234BCO');
  const right = eventOf({
    id: 1,
    text: '1234BCO',
    correction: { text: '1234BCD', author: 'Ann', time: '' },
  })!;
  assert.equal(textOf(right), '1234BCD');
  assert.equal(eventOf({ id: 1, text: 'A', correction: { text: 7 } })!.correction, null);
  const entry = watchEntryOf({
    plate: 'B*',
    label: 'van',
    errors: 0.25,
    direction: null,
    hours: '06:00-20:00',
    days: 'mon-fri',
  })!;
  assert.equal(whenText(entry), '06:00-20:00, mon-fri');
  assert.equal(whenText(watchEntryOf({ plate: '1' })!), 'always');
  assert.equal(watchEntryOf('x'), null);
  for (const good of ['', ' ', '22:00-06:00', '8:00-12:00  13:00-24:00']) assert.ok(areHours(good), good);
  for (const bad of ['8-9', '25:00-26:00', '08:00', '08:00-08:00', '1:00-2:00-3:00', '24:00-01:00'])
    assert.ok(!areHours(bad), bad);
  assert.equal(confidenceLevel(0.95), 'high');
  assert.equal(confidenceLevel(0.2), 'low');
});

test('people: lines, advice for each reason, deletion proof', () => {
  assert.equal(personOf({ name: '<b>Ann</b>', faces: 3 })?.name, '<b>Ann</b>');
  assert.equal(personOf({ name: 'Ann' }), null);
  assert.deepEqual(enrolResultOf('a.jpg', { name: 'Ann', added: 1, refused: {} }, ''), {
    name: 'a.jpg',
    accepted: true,
    reason: '',
  });
  assert.match(
    enrolResultOf('a.jpg', { added: 0, refused: { 'no face': 1 } }, '').reason,
    /look into the camera/,
  );
  assert.equal(enrolResultOf('a.jpg', undefined, 'gone').reason, 'gone');
  assert.equal(adviceFor('something new'), 'something new');
  assert.equal(proofOf({ name: 'Ann' }), null);
  assert.equal(proofOf({ name: 'Ann', proven: true, left_in: [] })?.proven, true);
  assert.deepEqual(
    identifiedFacesOf({
      faces: [{ box: [1, 2, 3, 4], label: 'Ann', known: true, confidence: 0.9 }, { box: 1 }],
    }).length,
    1,
  );
  assert.equal(nameProblem('Ann'), '');
  assert.notEqual(nameProblem('ä'.repeat(101)), '');
  assert.notEqual(nameProblem('a\nb'), '');
});

test('people: groups and corrections', () => {
  assert.deepEqual(groupOf({ group: 3, sightings: 2, first: 'a', last: 'b' }), {
    group: 3,
    sightings: 2,
    last: 'b',
  });
  assert.equal(groupOf({ group: '3' }), null);
  const one = correctionOf({ correction: 4, what: 'name', from: 'group 3', to: '<b>', undone: null });
  assert.ok(one);
  assert.equal(correctionText(one), 'group 3 is <b>');
  assert.equal(correctionText({ ...one, what: 'not', undone: true }), 'not group 3 (undone)');
  assert.equal(correctionText({ ...one, what: 'undo', undoes: 2 }), 'undid 2');
  assert.equal(correctionText({ ...one, what: 'something new' }), 'something new');
  assert.equal(correctionOf({ what: 'name' }), null);
});

test('faces on a sheet: enrolled faces and sightings', () => {
  const enrolled = {
    face: 7,
    name: 'Ann',
    time: 't',
    quality: 0.8,
    source: 'a.jpg',
    box: [128, 0, 128, 160],
  };
  assert.deepEqual(drawnFaceOf(enrolled), {
    id: 7,
    time: 't',
    source: 'a.jpg',
    quality: 0.8,
    box: [128, 0, 128, 160],
  });
  assert.equal(drawnFaceOf({ id: 3, group: 1, quality: 0.5 })?.id, 3);
  assert.equal(drawnFaceOf({ id: 3, group: 1, quality: 0.5 })?.box, null, 'no room on the sheet');
  assert.equal(drawnFaceOf({ name: 'Ann', faces: 3 }), null);
});

test('annotate: point names, number of Tab presses, keyboard cursor', () => {
  assert.equal(pointName(0, 68), 'jaw 1');
  assert.equal(pointName(67, 68), 'inner lip 8');
  assert.equal(pointName(3, 5), 'Point 4');
  assert.equal(tabsTo(-1, 0, 5), 1);
  assert.equal(tabsTo(3, 1, 5), 3);
  assert.equal(tabsTo(2, 2, 5), 5);
  assert.equal(tabsTo(0, 9, 5), 0);
  assert.deepEqual(moveCursor({ x: 1, y: 1 }, 'ArrowLeft', true, { width: 10, height: 10 }), { x: 0, y: 1 });
  assert.equal(moveCursor({ x: 1, y: 1 }, 'a', false, { width: 10, height: 10 }), null);
  assert.deepEqual(stateOf({ places: [[1, 2], null, 3] }).places, [[1, 2], null, null]);
  assert.equal(stateOf({}).selected, -1);
});

test('calibrate: rows with their deviations, views of the table', () => {
  const line = {
    model: 'pinhole',
    fx: 500.123,
    fy: 501,
    cx: 320,
    cy: 240,
    distortion: [0.1, 0.2],
    deviations: { fx: 0.5, fy: 0.5, cx: 0.1, cy: 0.1, distortion: [0.01, 0.02] },
  } as unknown as CameraLine;
  const rows = cameraRows(line);
  assert.deepEqual(rows[0], { name: 'Focal length x, px', value: '500.12', deviation: '± 0.50' });
  assert.equal(rows[4]!.name, 'Distortion k1');
  assert.equal(rows.length, 6);
  const view = viewOf({
    image: '5',
    found: '1',
    used: '0',
    points: '54',
    rms_px: '0.03',
    tilt_deg: '13.2',
    reason: 'alike',
  });
  assert.deepEqual(view, {
    image: '5',
    found: true,
    used: false,
    points: 54,
    rms: 0.03,
    tilt: 13.2,
    reason: 'alike',
  });
  assert.equal(squareProblem('25'), '');
  assert.notEqual(squareProblem('0'), '');
});

test('curves from printed lines or from progress', () => {
  const lines = [1, 2, 3].map((step) => ({ step, loss: 1 / step, seconds: step, name: 'x' }));
  assert.deepEqual(seriesOf(lines), [{ name: 'loss', x: [1, 2, 3], y: [1, 0.5, 1 / 3] }]);
  assert.deepEqual(seriesOf([{ output: 'a', samples: 3 }]), []);
  let samples = addSample([], { label: 'trees', share: 0, at: 1000 });
  samples = addSample(samples, { label: 'trees', share: 0, at: 1500 });
  samples = addSample(samples, { label: 'trees', share: 1, at: 2000 });
  assert.deepEqual(progressSeries(samples), [{ name: 'trees', x: [0, 1], y: [0, 100] }]);
  assert.equal(polyline({ name: '', x: [0, 1], y: [0, 2] }, 100, 50, 0, 2, 0, 1), '0,50 100,0');
});

test('figures of two models are compared', () => {
  const rows = compare({ nme_mean: 4, recall: 0.9, faces: 20 }, { nme_mean: 5, recall: 0.95, faces: 20 });
  assert.deepEqual(
    rows.map((one) => [one.name, one.better]),
    [
      ['nme_mean', 'mine'],
      ['recall', 'shipped'],
      ['faces', 'same'],
    ],
  );
  assert.equal(compare({ a: 1 }, undefined)[0]!.better, null);
});

test('CSV with quotes; the worst cases first', () => {
  const rows = parseCsv('image,nme,missed\n"a,""b"".jpg",3.5,0\r\nc.jpg,2,1\nd.jpg,9,0\nshort\n');
  assert.equal(rows[0]!.image, 'a,"b".jpg');
  assert.deepEqual(
    worstFirst(rows).map((one) => one.image),
    ['c.jpg', 'd.jpg', 'a,"b".jpg'],
  );
});

test('missed detections have no error', () => {
  const cells = (row: Record<string, string>) =>
    caseColumns(Object.keys(row)).map((name) => caseCell(row, name));
  const faces = parseCsv(
    'image,nme,missed,wrong,dx,lost,ms\na/b.png,0.0000,1,0,0.0000,0,12.34\nc.png,3.4567,0,1,-1.251,0,9.00\n',
  );
  assert.deepEqual(caseColumns(Object.keys(faces[0]!)), ['image', 'outcome', 'nme', 'dx', 'ms']);
  assert.deepEqual(faces.map(cells), [
    ['b.png', 'not found', '–', '–', '12.34'],
    ['c.png', 'another face', '3.46', '-1.25', '9.00'],
  ]);
  const plates = parseCsv(
    'image,truth,found,text,confidence,edits,exact\na,B1,1,B1,0.9152,0,1\nb,C3,0,,,2,0\nc,D4,1,D5,0.5,1,0\n',
  );
  assert.deepEqual(worstFirst(plates).map(cells), [
    ['b', 'not found', 'C3', '–', '–', '–', '–'],
    ['c', 'found', 'D4', 'D5', '50 %', '1', 'no'],
    ['a', 'found', 'B1', 'B1', '92 %', '0', 'yes'],
  ]);
  assert.deepEqual(caseColumns(['image', 'ms']), ['image', 'ms']);
  assert.equal(caseLabel('exact'), 'Read exactly');
  assert.equal(metricLabel('center_error_px'), 'Center error, px');
});

test('requests for training and evaluation', () => {
  const verb = (name: string) => trainVerbs.find((one) => one.verb === name)!;
  assert.deepEqual(trainRequest(verb('aam train'), 'ws:a.points.json', { '--mirror': true }), {
    inputs: ['ws:a.points.json'],
    flags: { '--mirror': true, '--output': 'out:aam.json' },
  });
  assert.deepEqual(trainRequest(verb('people train'), '', {}), { inputs: [], flags: {} });
  const plates = evalVerbs.find((one) => one.model === '--reader')!;
  assert.deepEqual(evalRequest(plates, 'job:1/cars', 'job:2/reader.json', {}).flags, {
    '--reader': 'job:2/reader.json',
    '--truth': 'job:1/cars/truth.csv',
    '--csv': 'out:cases.csv',
    '--errors': true,
  });
  // The shipped model is named, so that a model of the user's own is not taken for it.
  assert.equal(evalRequest(plates, 'job:1/cars', null, {}).flags['--reader'], 'model:plate-reader');
  assert.equal(synthRequest('gallery'), null);
  assert.deepEqual(dataOfJob('points', ['heads/set.json', 'heads/truth.jsonl']), ['heads/set.json']);
  assert.deepEqual(dataOfJob('plates', ['cars/truth.csv']), ['cars']);
});

test('names of sets and files, and where a reference is found', () => {
  assert.equal(cleanName('Frédéric & Co'), 'Fre-de-ric-Co');
  assert.equal(cleanName('<>'), 'set');
  assert.equal(setName('photos', new Date(2026, 0, 2, 3, 4, 5)), 'photos-20260102-030405');
  const taken = new Set<string>();
  assert.equal(fileName('C:\\x\\a.jpg', taken), 'a.jpg');
  assert.equal(fileName('A.jpg', taken), 'A-2.jpg');
  assert.equal(fileName('../../.hidden', taken), 'hidden');
  assert.equal(fileName('<img onerror>.jpg', taken), '_img onerror_.jpg');
  assert.equal(addressOf('set:a/b c.jpg', 160), '/api/sets/a/files/b%20c.jpg?width=160');
  assert.equal(addressOf('/x/jobs/ab/files/heads/images/0.png'), '/api/jobs/ab/files/heads/images/0.png');
  assert.equal(addressOf('/etc/passwd'), null);
});

// Answers requests with `answer` while `run` runs; returns them as "METHOD PATH".
async function withServer(
  answer: (request: string) => { status: number; body?: object },
  run: () => Promise<void>,
): Promise<string[]> {
  const requests: string[] = [];
  const real = globalThis.fetch;
  globalThis.fetch = (path, init) => {
    const request = `${init?.method ?? 'GET'} ${String(path)}`;
    requests.push(request);
    const { status, body } = answer(request);
    return Promise.resolve(new Response(status === 204 ? null : JSON.stringify(body), { status }));
  };
  try {
    await run();
  } finally {
    globalThis.fetch = real;
  }
  return requests;
}

test('a later upload replaces no image of the set', async () => {
  const requests = await withServer(
    () => ({ status: 204 }),
    async () => {
      const files = ['img_1.jpg', 'b.jpg'].map((name) => ({ name, body: new Blob(['x']) }));
      await uploadAll('s', files, () => undefined, ['IMG_1.jpg']);
    },
  );
  assert.deepEqual(requests, ['PUT /api/sets/s/files/img_1-2.jpg', 'PUT /api/sets/s/files/b.jpg']);
});

test('a session that quits is waited for, and its error is said', async () => {
  const session = { running: true, exit: null, error: null, log: [] };
  const ended = { running: false, exit: 6, error: 'camera.yaml: is a folder', log: ['tarsier: error: x'] };
  for (const status of [204, 409]) {
    let asked = 0;
    await withServer(
      (request) =>
        request.startsWith('POST')
          ? { status, body: { error: 'this session ended before it handled the events' } }
          : { status: 200, body: status === 204 && ++asked < 3 ? session : ended },
      async () => {
        const last = await quitSession('a', 0);
        assert.equal(problemOfSession(last), 'camera.yaml: is a folder');
      },
    );
  }
  await withServer(
    (request) =>
      request.startsWith('POST') ? { status: 409, body: { error: 'busy' } } : { status: 200, body: session },
    () => assert.rejects(quitSession('a', 0), /busy/),
  );
  const found = (exit: number, log: string[]) => problemOfSession({ ...ended, exit, log } as never);
  assert.equal(found(0, []), '');
  assert.equal(found(1, ['a', 'tarsier: warning: no view was taken']), 'no view was taken');
  assert.equal(found(1, []), 'The session failed.');
});
