// What the Annotate page knows of the session's state: pure.

export const stages: readonly { name: string; action: string; title: string; text: string }[] = [
  {
    name: 'pick',
    action: 'stage-pick',
    title: 'Frames',
    text: 'Select frames of the video: "pick" selects the current frame.',
  },
  {
    name: 'points',
    action: 'stage-points',
    title: 'Points',
    text: 'Click each point on the first image, in the order of the point numbers.',
  },
  {
    name: 'connections',
    action: 'stage-connections',
    title: 'Lines',
    text: 'Click two points to draw a line between them. Click them again to remove it. Lines are only a visual aid.',
  },
  {
    name: 'symmetry',
    action: 'stage-symmetry',
    title: 'Mirrored points',
    text: 'Click two points that mirror each other, such as the outer corners of the eyes. A point on the symmetry axis mirrors itself.',
  },
  {
    name: 'images',
    action: 'stage-images',
    title: 'All images',
    text: 'The program proposes points. Drag points that are wrong, then choose "Confirm and continue". Proposals improve with each image.',
  },
];

export interface AnnotateState {
  stage: string;
  image: number;
  images: number;
  done: number;
  points: number;
  shown: number;
  selected: number;
  agreed: boolean;
  learning: boolean;
  path: string;
  message: string;
  places: ([number, number] | null)[] | null;
}

export function stateOf(value: Record<string, unknown>): AnnotateState {
  const n = (name: string) => (typeof value[name] === 'number' ? (value[name] as number) : 0);
  const s = (name: string) => (typeof value[name] === 'string' ? (value[name] as string) : '');
  const places = Array.isArray(value.places)
    ? value.places.map((one): [number, number] | null =>
        Array.isArray(one) && typeof one[0] === 'number' && typeof one[1] === 'number'
          ? [one[0], one[1]]
          : null,
      )
    : null;
  return {
    stage: s('stage'),
    image: n('image'),
    images: n('images'),
    done: n('done'),
    points: n('points'),
    shown: n('shown'),
    selected: typeof value.selected === 'number' ? value.selected : -1,
    agreed: value.agreed === true,
    learning: value.learning === true,
    path: s('path'),
    message: s('message'),
    places,
  };
}

const parts68: readonly [number, string][] = [
  [17, 'jaw'],
  [22, 'left brow'],
  [27, 'right brow'],
  [31, 'bridge of the nose'],
  [36, 'below the nose'],
  [42, 'left eye'],
  [48, 'right eye'],
  [60, 'outer lip'],
  [68, 'inner lip'],
];

// "Point 3", and of the 68 points of a face the part, too.
export function pointName(index: number, points: number): string {
  if (points === 68) {
    let from = 0;
    for (const [to, name] of parts68) {
      if (index < to) return `${name} ${index - from + 1}`;
      from = to;
    }
  }
  return `Point ${index + 1}`;
}

// How often Tab goes from the point that is chosen to another: the session counts round.
export function tabsTo(selected: number, wanted: number, points: number): number {
  if (points <= 0 || wanted < 0 || wanted >= points) return 0;
  const from = selected < 0 ? -1 : selected;
  const steps = wanted - from;
  return steps > 0 ? steps : steps + points;
}

// The cursor of the keyboard in the image: moved by arrows, by one or ten pixels, kept inside.
export function moveCursor(
  at: { x: number; y: number },
  key: string,
  wide: boolean,
  size: { width: number; height: number },
): { x: number; y: number } | null {
  const step = wide ? 20 : 2;
  const by: Record<string, [number, number]> = {
    ArrowLeft: [-step, 0],
    ArrowRight: [step, 0],
    ArrowUp: [0, -step],
    ArrowDown: [0, step],
  };
  const d = by[key];
  if (!d) return null;
  return {
    x: Math.min(size.width - 1, Math.max(0, at.x + d[0])),
    y: Math.min(size.height - 1, Math.max(0, at.y + d[1])),
  };
}
