// What the People page knows of the lines of `people ..`: pure.

export interface Person {
  name: string;
  faces: number;
  note: string;
  time: string;
}

export interface Sighting {
  id: number;
  face: boolean; // it is kept
  time: string;
  source: string;
  label: string;
  known: boolean;
  confidence: number;
}

export interface Proof {
  name: string;
  faces: number;
  sightings: number;
  pieces: number;
  pieces_searched: number;
  searched: string[];
  bytes: number;
  left_in: string[];
  unread: string[];
  skipped: string[];
  shared_with: string[];
  unproven: number;
  proven: boolean;
}

export interface EnrolResult {
  name: string;
  accepted: boolean;
  reason: string;
}

type Fields = Record<string, unknown>;
const fields = (line: unknown): Fields | null =>
  typeof line === 'object' && line !== null && !Array.isArray(line) ? (line as Fields) : null;
const word = (value: unknown) => (typeof value === 'string' ? value : '');
const count = (value: unknown) => (typeof value === 'number' && Number.isFinite(value) ? value : 0);
const list = (value: unknown) => (Array.isArray(value) ? value.map(String) : []);

export function personOf(line: unknown): Person | null {
  const v = fields(line);
  if (!v || typeof v.name !== 'string' || typeof v.faces !== 'number') return null;
  return { name: v.name, faces: v.faces, note: word(v.note), time: word(v.time) };
}

export function sightingOf(line: unknown): Sighting | null {
  const v = fields(line);
  if (!v || typeof v.time !== 'string' || !('known' in v)) return null;
  return {
    id: count(v.id),
    face: v.face === true,
    time: v.time,
    source: word(v.source),
    label: word(v.label),
    known: v.known === true,
    confidence: count(v.confidence),
  };
}

export interface Group {
  group: number;
  sightings: number;
  last: string;
}

export function groupOf(line: unknown): Group | null {
  const v = fields(line);
  if (!v || typeof v.group !== 'number' || typeof v.sightings !== 'number') return null;
  return { group: v.group, sightings: v.sightings, last: word(v.last) };
}

// An enrolled face, or one that was seen, on a sheet of them.
export interface DrawnFace {
  id: number;
  time: string;
  source: string;
  quality: number;
  box: [number, number, number, number] | null; // in the sheet, px; null: it found no room there
}

export function drawnFaceOf(line: unknown): DrawnFace | null {
  const v = fields(line);
  const id = v?.face ?? v?.id;
  if (!v || typeof id !== 'number' || typeof v.quality !== 'number') return null;
  const box = Array.isArray(v.box) && v.box.length === 4 ? (v.box.map(count) as DrawnFace['box']) : null;
  return { id, time: word(v.time), source: word(v.source), quality: v.quality, box };
}

export interface Correction {
  correction: number;
  time: string;
  who: string;
  what: string;
  from: string;
  to: string;
  undone: boolean;
  undoes: number;
}

export function correctionOf(line: unknown): Correction | null {
  const v = fields(line);
  if (!v || typeof v.correction !== 'number' || typeof v.what !== 'string') return null;
  return {
    correction: v.correction,
    time: word(v.time),
    who: word(v.who),
    what: v.what,
    from: word(v.from),
    to: word(v.to),
    undone: typeof v.undone === 'number',
    undoes: count(v.undoes),
  };
}

export function correctionText(one: Correction): string {
  const done = one.undone ? ' (undone)' : '';
  switch (one.what) {
    case 'name':
      return `${one.from} is ${one.to}${done}`;
    case 'not':
      return `not ${one.from}${done}`;
    case 'move':
      return `moved from ${one.from} to ${one.to}${done}`;
    case 'split':
    case 'split group':
      return `split off from ${one.from} as ${one.to}${done}`;
    case 'merge':
    case 'merge groups':
      return `${one.from} merged into ${one.to}${done}`;
    case 'undo':
      return `undid ${one.undoes}`;
    default:
      return one.what;
  }
}

export function proofOf(line: unknown): Proof | null {
  const v = fields(line);
  if (!v || !('proven' in v)) return null;
  return {
    name: word(v.name),
    faces: count(v.faces),
    sightings: count(v.sightings),
    pieces: count(v.pieces),
    pieces_searched: count(v.pieces_searched),
    searched: list(v.searched),
    bytes: count(v.bytes),
    left_in: list(v.left_in),
    unread: list(v.unread),
    skipped: list(v.skipped),
    shared_with: list(v.shared_with),
    unproven: count(v.unproven),
    proven: v.proven === true,
  };
}

// What to do about a reason for which a face was not accepted.
const advice: readonly [RegExp, string][] = [
  [/no face/, 'no face was found: look into the camera, with the face upright and not covered'],
  [/several|more than one/, 'more than one face: take an image of this person alone'],
  [/small/, 'the face is too small: move closer'],
  [/blur|sharp/, 'blurred: hold still, use more light'],
  [/turn/, 'turned away: look more towards the camera'],
  [/tilt/, 'tilted: hold the head upright'],
  [/dark/, 'too dark: use more light on the face'],
  [/bright|light|grey/, 'wrong exposure: avoid very dark and very bright light'],
  [/contrast/, 'too little contrast: use more light from one side'],
  [/clip/, 'over- or underexposed parts: use softer light'],
  [/uneven|side/, 'lit from one side: turn towards the light'],
  [/alike|differ|same/, 'too similar to an accepted face: turn the head slightly'],
  [/soon/, 'too soon after the last image'],
];

export function adviceFor(reason: string): string {
  const found = advice.find(([pattern]) => pattern.test(reason.toLowerCase()));
  return found ? found[1] : reason;
}

// What became of one image, of the line of `people enroll` for it alone.
export function enrolResultOf(name: string, line: unknown, error: string): EnrolResult {
  const v = fields(line);
  if (v && count(v.added) > 0) return { name, accepted: true, reason: '' };
  const refused = v ? fields(v.refused) : null;
  const reasons = refused ? Object.keys(refused) : [];
  return {
    name,
    accepted: false,
    reason: reasons.map(adviceFor).join('; ') || error || 'no face was accepted',
  };
}

export interface IdentifiedFace {
  box: [number, number, number, number];
  label: string | null;
  known: boolean;
  confidence: number;
}

export function identifiedFacesOf(line: unknown): IdentifiedFace[] {
  const v = fields(line);
  if (!v || !Array.isArray(v.faces)) return [];
  return v.faces.flatMap((face) => {
    const f = fields(face);
    if (!f || !Array.isArray(f.box) || f.box.length !== 4) return [];
    return [
      {
        box: f.box.map(count) as IdentifiedFace['box'],
        label: typeof f.label === 'string' ? f.label : null,
        known: f.known === true,
        confidence: count(f.confidence),
      },
    ];
  });
}

// A name that the gallery takes: up to 200 bytes, one line.
export function nameProblem(name: string): string {
  const text = name.trim();
  if (text === '') return '';
  if (new TextEncoder().encode(text).length > 200) return 'A name may have at most 200 bytes.';

  if (/[\u0000-\u001f\u007f]/.test(text)) return 'A name must be one line.';
  return '';
}
