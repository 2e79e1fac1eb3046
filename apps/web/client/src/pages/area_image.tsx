// One drawing an area, made of plain shapes in the studio's colours. Decoration: the card says the same in words.

function Face({ line }: { line?: boolean }) {
  return (
    <g class={line ? 'd-line' : 'd-skin'}>
      <ellipse cx="80" cy="50" rx="24" ry="30" />
    </g>
  );
}

const EYES = (
  <g class="d-dark">
    <circle cx="71" cy="45" r="3" />
    <circle cx="89" cy="45" r="3" />
  </g>
);

const dots = (points: [number, number][], r = 1.7) =>
  points.map(([x, y]) => <circle key={`${x} ${y}`} cx={x} cy={y} r={r} />);

const OUTLINE: [number, number][] = [
  [57, 40],
  [58, 52],
  [62, 64],
  [70, 74],
  [80, 79],
  [90, 74],
  [98, 64],
  [102, 52],
  [103, 40],
];
const INNER: [number, number][] = [
  [66, 38],
  [74, 36],
  [86, 36],
  [94, 38],
  [68, 46],
  [74, 46],
  [86, 46],
  [92, 46],
  [80, 50],
  [80, 57],
  [72, 66],
  [80, 68],
  [88, 66],
  [80, 63],
];

function Cartoon() {
  return (
    <>
      <rect class="d-half" x="80" y="0" width="80" height="100" />
      <Face />
      <path
        class="d-hair"
        d="M55 46c-2-24 12-32 25-32s27 8 25 32c-4-10-8-15-12-17-10 3-20 3-27 0-5 3-8 8-11 17z"
      />
      {EYES}
      <path class="d-stroke" d="M70 66q10 7 20 0M80 48l-3 10h5" />
      <path class="d-stroke d-thick" d="M80 14c14 0 26 8 25 32 0 22-12 34-25 34" />
      <path class="d-stroke" d="M112 20l10-8M116 34l12-3M114 70l11 6M108 84l7 9" />
    </>
  );
}

function Plates() {
  return (
    <>
      <path class="d-ground" d="M0 78h160v22H0z" />
      <path class="d-body" d="M26 78V58l14-4 16-20h48l16 20 14 4v20z" />
      <path class="d-glass" d="M60 38h18v14H48zM82 38h19l12 14H82z" />
      <circle class="d-dark" cx="46" cy="78" r="10" />
      <circle class="d-dark" cx="114" cy="78" r="10" />
      <rect class="d-plate" x="60" y="62" width="40" height="13" rx="2" />
      <text class="d-text" x="80" y="72">
        4821 KTR
      </text>
      <path class="d-mark" d="M55 63v-6h8M105 63v-6h-8M55 74v6h8M105 74v6h-8" />
    </>
  );
}

function Landmarks() {
  return (
    <>
      <Face />
      <g class="d-point">
        {dots(OUTLINE)}
        {dots(INNER)}
      </g>
    </>
  );
}

function Pose() {
  return (
    <>
      <Face />
      <g class="d-glasses">
        <circle cx="71" cy="45" r="9" />
        <circle cx="91" cy="44" r="9" />
        <path d="M80 44h2M62 44l-6-3M100 43l4-3" />
      </g>
      <path class="d-stroke" d="M71 66q10 6 19 0" />
      <path class="d-axis-x" d="M82 54h44" />
      <path class="d-axis-y" d="M82 54V12" />
      <path class="d-axis-z" d="M82 54l-34 24" />
    </>
  );
}

function People() {
  return (
    <>
      {[38, 80, 122].map((x, index) => (
        <g key={x}>
          <ellipse class={index === 1 ? 'd-skin' : 'd-body'} cx={x} cy="42" rx="13" ry="16" />
          <path class={index === 1 ? 'd-hair' : 'd-ground'} d={`M${x - 20} 84c1-18 9-24 20-24s19 6 20 24z`} />
        </g>
      ))}
      <path class="d-mark" d="M60 30v-9h9M100 30v-9h-9M60 54v9h9M100 54v9h-9" />
      <text class="d-name" x="80" y="95">
        Ann
      </text>
    </>
  );
}

function Markers() {
  return (
    <>
      <path class="d-paper" d="M30 62l62-10 40 28-72 14z" />
      <path class="d-dark" d="M46 65l40-7 26 17-46 9z" />
      <path class="d-paper" d="M62 69l14-3 12 7-15 4z" />
      <path class="d-cube" d="M46 65V30l40-7 26 17v35" />
      <path class="d-cube" d="M46 30l20 16 46-6M66 46v38" />
    </>
  );
}

function Appearance() {
  return (
    <>
      <Face line />
      <path
        class="d-mesh"
        d="M57 40l9-2 8-2 6 14 6-14 8 2 9 2M57 40l1 12 10-6 6 0 6 4 6-4 6 0 10 6 1-12M58 52l4 12 10 2 8-9 8 9 10-2 4-12M62 64l8 10 10 5 10-5 8-10M72 66l-2 8M88 66l2 8M80 57v-7M72 66l8 2 8-2M80 68v11M68 46l-2-8M92 46l2-8M80 50l-12-4M80 50l12-4M80 57l-18 7M80 57l18 7"
      />
    </>
  );
}

function Reconstruct() {
  const cloud: [number, number][] = [];
  for (let i = 0; i < 90; i += 1) {
    const angle = i * 2.399;
    const radius = 3.1 * Math.sqrt(i);
    cloud.push([
      Math.round((80 + radius * Math.cos(angle) * 1.2) * 10) / 10,
      Math.round((46 + radius * Math.sin(angle) * 0.9) * 10) / 10,
    ]);
  }
  return (
    <>
      <g class="d-cloud">{dots(cloud, 1.4)}</g>
      <path class="d-camera" d="M14 80l16-8 4 14zM70 94l10-12 10 12zM146 80l-16-8-4 14z" />
      <path class="d-ray" d="M32 76L66 56M80 82V64M128 76L96 56" />
    </>
  );
}

function Calibrate() {
  const cells = [];
  for (let row = 0; row < 5; row += 1)
    for (let column = 0; column < 7; column += 1)
      if ((row + column) % 2 === 0)
        cells.push(
          <rect key={`${row} ${column}`} x={38 + column * 12} y={20 + row * 12} width="12" height="12" />,
        );
  return (
    <g class="d-tilt">
      <rect class="d-paper" x="32" y="14" width="96" height="72" />
      <g class="d-dark">{cells}</g>
      <path class="d-mark" d="M38 20q42-5 84 0M38 80q42 5 84 0M38 20q-4 30 0 60M122 20q4 30 0 60" />
    </g>
  );
}

const IMAGES: Record<string, () => preact.JSX.Element> = {
  cartoon: Cartoon,
  plates: Plates,
  landmarks: Landmarks,
  pose: Pose,
  people: People,
  markers: Markers,
  aam: Appearance,
  reconstruct: Reconstruct,
  calibrate: Calibrate,
};

export function AreaImage({ id }: { id: string }) {
  const Image = IMAGES[id];
  return (
    <svg class="area-image" viewBox="0 0 160 100" aria-hidden="true">
      {Image && <Image />}
    </svg>
  );
}

// The animal itself; the same drawing as the icon.
export function Tarsier() {
  return (
    <svg class="hero-image" viewBox="0 0 96 96" aria-hidden="true">
      <path
        d="M13 30C2 16 10 3 20 9c7 4 11 10 12 16zM83 30c11-14 3-27-7-21-7 4-11 10-12 16z"
        fill="#8a5a34"
      />
      <path d="M17 25c-5-8-2-14 3-11 4 2 6 6 7 9zM79 25c5-8 2-14-3-11-4 2-6 6-7 9z" fill="#d9a27c" />
      <ellipse cx="48" cy="50" rx="38" ry="34" fill="#a9713f" />
      <path d="M48 22c5 9 5 22 0 34-5-12-5-25 0-34z" fill="#e6c39b" />
      <ellipse cx="48" cy="72" rx="15" ry="10" fill="#e6c39b" />
      <circle cx="29" cy="47" r="19" fill="#3b2412" />
      <circle cx="67" cy="47" r="19" fill="#3b2412" />
      <circle cx="29" cy="47" r="17" fill="#e79a2c" />
      <circle cx="67" cy="47" r="17" fill="#e79a2c" />
      <circle cx="30" cy="47" r="8" fill="#14100c" />
      <circle cx="66" cy="47" r="8" fill="#14100c" />
      <circle cx="27" cy="43" r="3.2" fill="#fff" />
      <circle cx="63" cy="43" r="3.2" fill="#fff" />
      <path d="M44 67h8l-4 4z" fill="#3b2412" />
      <path d="M38 75q10 6 20 0" fill="none" stroke="#3b2412" stroke-width="2" stroke-linecap="round" />
    </svg>
  );
}
