// The studio's own line drawings, one an area: 24 by 24.
const PATHS: Record<string, string> = {
  home: 'M4 11l8-7 8 7M6 10v9h12v-9M10 19v-5h4v5',
  live: 'M3 6h13v12H3zM16 10l5-3v10l-5-3',
  plates: 'M2 8h20v8H2zM5.5 10.5v3M8.5 10.5h2v3h-2zM13 10.5v3M16 10.5h2.5l-2.5 3h2.5',
  people:
    'M8.5 11a3.5 3.5 0 1 0 0-7 3.5 3.5 0 0 0 0 7zM2.5 20c0-4 2.5-6.5 6-6.5s6 2.5 6 6.5M16 11a3 3 0 1 0-1-5.8M17 13.7c2.7.4 4.5 2.6 4.5 6.3',
  reconstruct: 'M12 3l8 4.5v9L12 21l-8-4.5v-9zM4 7.5l8 4.5 8-4.5M12 12v9',
  annotate: 'M5 19l1-4L16 5l3 3L9 18zM14 7l3 3M4 22h10',
  calibrate: 'M4 4h16v16H4zM4 9.3h16M4 14.6h16M9.3 4v16M14.6 4v16',
  train: 'M3 3v18h18M6 8c3 8 7 9 14 10',
  explore: 'M4 7h9M17 7h3M4 12h3M11 12h9M4 17h11M19 17h1M13 5v4h4V5zM7 10v4h4v-4zM15 15v4h4v-4z',
  system: 'M4 5h16v10H4zM8 20h8M12 15v5M7 12l2.5-3 2 2L15 8',
  api: 'M8 6l-5 6 5 6M16 6l5 6-5 6M13.5 5l-3 14',
};

export function AreaIcon({ name }: { name: string }) {
  return (
    <svg class="icon" viewBox="0 0 24 24" aria-hidden="true">
      <path d={PATHS[name] ?? PATHS['home']} />
    </svg>
  );
}
