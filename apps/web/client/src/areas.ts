// What a visitor can try, one entry an area: the verb, synthetic data that shows it, and whether a camera makes sense.
import type { Flags } from './api';

export interface Trial {
  id: string;
  title: string;
  text: string;
  verb?: string;
  inputs: string[];
  flags: Flags;
  camera: boolean;
  page?: string; // where more of it is
  start?: string; // a page that begins by itself, where no session is the first result
}

export const TRIALS: Trial[] = [
  {
    id: 'cartoon',
    title: 'Cartoon',
    text: 'Turns live video into a sketch, a painting or a cartoon.',
    verb: 'cartoon run',
    inputs: ['synth:portrait?live=1'],
    flags: {},
    camera: true,
  },
  {
    id: 'plates',
    title: 'Number plates',
    text: 'Detects and reads the number plates of passing cars.',
    verb: 'plate read',
    inputs: ['synth:drive?live=1&fps=5'],
    flags: {},
    camera: true,
    page: '/plates',
  },
  {
    id: 'landmarks',
    title: 'Facial landmarks',
    text: 'Detects and tracks the 68 landmarks of each face.',
    verb: 'landmarks track',
    inputs: ['synth:portrait?live=1'],
    flags: {},
    camera: true,
    page: '/annotate',
  },
  {
    id: 'pose',
    title: 'Head pose',
    text: 'Estimates the pose of each head and draws glasses on it.',
    verb: 'pose track',
    inputs: ['synth:portrait?live=1'],
    flags: { '--draw': 'glasses' },
    camera: true,
  },
  {
    id: 'people',
    title: 'People',
    text: 'Enrols people and identifies their faces. All data stays on this machine.',
    verb: 'people live',
    inputs: ['synth:portrait?live=1'],
    flags: {},
    camera: true,
    page: '/people',
  },
  {
    id: 'markers',
    title: 'Markers',
    text: 'Detects printed markers and draws objects on them.',
    verb: 'ar markers',
    inputs: ['synth:markers?live=1'],
    flags: { '--focal': 608, '--draw': 'cube' },
    camera: true,
  },
  {
    id: 'aam',
    title: 'Appearance models',
    text: 'Fits the shape and texture of a whole face to the image.',
    verb: 'aam fit',
    inputs: ['synth:portrait?live=1'],
    flags: {},
    camera: true,
    page: '/explore',
  },
  {
    id: 'reconstruct',
    title: 'Structure from motion',
    text: 'Computes camera poses and a point cloud from images.',
    inputs: [],
    flags: {},
    camera: false,
    page: '/reconstruct',
    start: '/reconstruct?try=synthetic',
  },
  {
    id: 'calibrate',
    title: 'Calibration',
    text: 'Calibrates a camera with a printed board.',
    verb: 'calibrate',
    inputs: ['synth:board?live=1'],
    flags: { '--board': 'chess:9x6', '--square': '25mm', '--output': 'ws:camera-drawn.yaml' },
    camera: false,
    page: '/calibrate',
  },
];

// What people call a session: the name it was given, else its area's.
export function sessionName(session: { name: string; title: string; verb: string }): string {
  const trial = TRIALS.find((one) => one.verb === session.verb);
  if (session.name && session.name !== session.verb) return session.name;
  return trial?.title || session.title || session.verb;
}
