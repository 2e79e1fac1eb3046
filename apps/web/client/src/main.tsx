import { render, type ComponentType } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { api, offline, serverInfo, signedIn } from './api';
import { useSignalValue } from './hooks';
import { startKeys } from './key_map';
import { liveLink, startLive } from './live';
import { route, startRouter } from './router';
import { AreaIcon } from './ui/icons';
import { CameraBar } from './ui/camera_bar';
import { Button, Eyes, Notice } from './ui/controls';
import { Toasts } from './ui/toast';
import { Home } from './pages/home';
import { SignIn } from './pages/sign_in';
import { signInProblem } from './pages/sign_in_state';

type Page = ComponentType;

// Pages are loaded when they are first opened.
const LAZY: Record<string, () => Promise<Page>> = {
  live: async () => (await import('./pages/live')).Live,
  session: async () => (await import('./pages/session')).SessionPage,
  plates: async () => (await import('./pages/plates')).Plates,
  people: async () => (await import('./pages/people')).People,
  reconstruct: async () => (await import('./pages/reconstruct')).Reconstruct,
  annotate: async () => (await import('./pages/annotate')).Annotate,
  calibrate: async () => (await import('./pages/calibrate')).Calibrate,
  train: async () => (await import('./pages/train')).Train,
  explore: async () => (await import('./pages/explore')).Explore,
  system: async () => (await import('./pages/system')).System,
  api: async () => (await import('./pages/api_page')).ApiPage,
};

const NAV: { page: string; label: string }[] = [
  { page: '', label: 'Home' },
  { page: 'live', label: 'Live' },
  { page: 'plates', label: 'Plates' },
  { page: 'people', label: 'People' },
  { page: 'reconstruct', label: 'Reconstruct' },
  { page: 'annotate', label: 'Annotate' },
  { page: 'calibrate', label: 'Calibrate' },
  { page: 'train', label: 'Train' },
  { page: 'explore', label: 'Explore' },
  { page: 'system', label: 'System' },
  { page: 'api', label: 'API' },
];

function Missing() {
  return (
    <div class="empty">
      <Eyes />
      <h1 tabIndex={-1}>This page does not exist</h1>
      <p>
        <a href="/">Go to the home page</a>
      </p>
    </div>
  );
}

function Body({ page }: { page: string }) {
  const [lazy, setLazy] = useState<{ page: string; show: Page | null; problem: string }>({
    page: '',
    show: null,
    problem: '',
  });
  const main = useRef<HTMLElement>(null);
  const first = useRef(true);
  useEffect(() => {
    const load = LAZY[page];
    if (!load) return;
    let current = true;
    load().then(
      (show) => current && setLazy({ page, show, problem: '' }),
      () =>
        current &&
        setLazy({
          page,
          show: null,
          problem: 'This page could not be loaded. Check that the server is running.',
        }),
    );
    return () => {
      current = false;
    };
  }, [page]);
  const ready = page === '' || page === 'missing' || lazy.page === page;
  useEffect(() => {
    if (!ready) return;
    const name = NAV.find((one) => one.page === page)?.label ?? (page === 'session' ? 'Session' : 'Tarsier');
    document.title = page === '' ? 'Tarsier studio' : `${name} – Tarsier studio`;
    // The new page's heading takes the focus, so that it is read out and Tab goes on from there.
    if (!first.current) main.current?.querySelector<HTMLElement>('h1')?.focus({ preventScroll: true });
    first.current = false;
  }, [page, ready]);
  const Show = lazy.show;
  return (
    <main id="main" ref={main} data-page={page === '' ? 'home' : page} data-ready={ready ? 'yes' : 'no'}>
      {page === '' && <Home />}
      {page === 'missing' && <Missing />}
      {page !== '' && page !== 'missing' && lazy.page === page && lazy.problem && (
        <Notice kind="problem">{lazy.problem}</Notice>
      )}
      {page !== '' && page !== 'missing' && lazy.page === page && Show && <Show />}
      {!ready && <p class="faint">Loading</p>}
    </main>
  );
}

const THEMES = ['auto', 'light', 'dark'] as const;
type Theme = (typeof THEMES)[number];

function savedTheme(): Theme {
  try {
    const saved = localStorage.getItem('theme');
    return THEMES.find((one) => one === saved) ?? 'auto';
  } catch {
    return 'auto';
  }
}

function useTheme(): [Theme, () => void] {
  const [theme, setTheme] = useState<Theme>(savedTheme);
  useEffect(() => {
    if (theme === 'auto') delete document.documentElement.dataset['theme'];
    else document.documentElement.dataset['theme'] = theme;
    try {
      localStorage.setItem('theme', theme);
    } catch {
      // Private windows may refuse; the choice lasts until the tab is closed.
    }
  }, [theme]);
  return [theme, () => setTheme(THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length] ?? 'auto')];
}

function Shell() {
  const now = useSignalValue(route);
  const signed = useSignalValue(signedIn);
  const gone = useSignalValue(offline);
  const link = useSignalValue(liveLink);
  const info = useSignalValue(serverInfo);
  const [menu, setMenu] = useState(false);
  const [theme, nextTheme] = useTheme();
  useEffect(() => setMenu(false), [now]);

  if (signed === undefined) {
    return (
      <main id="main" data-page="loading">
        {gone ? (
          <Notice kind="problem">The server does not respond. Check that tarsier serve is running.</Notice>
        ) : (
          <p>Loading</p>
        )}
      </main>
    );
  }
  if (!signed) return <SignIn />;
  if (now.page === 'session' && now.query.get('only') === 'image') return <Body page="session" />;

  return (
    <>
      <a class="skip" href="#main">
        Skip to the content
      </a>
      <div class="shell">
        <header class="side">
          <div class="side-top">
            <a class="brand" href="/" aria-label="Tarsier studio, home page">
              <Eyes />
              <span>Tarsier</span>
            </a>
            <Button
              class="menu-button"
              aria-expanded={menu}
              aria-controls="menu"
              onClick={() => setMenu(!menu)}
            >
              Menu
            </Button>
          </div>
          <nav id="menu" class={menu ? 'is-open' : undefined} aria-label="Pages">
            <ul>
              {NAV.map((one) => (
                <li key={one.page}>
                  <a
                    href={`/${one.page}`}
                    aria-current={
                      now.page === one.page || (one.page === 'live' && now.page === 'session')
                        ? 'page'
                        : undefined
                    }
                  >
                    <AreaIcon name={one.page === '' ? 'home' : one.page} />
                    {one.label}
                  </a>
                </li>
              ))}
            </ul>
            <div class="side-foot">
              <Button kind="quiet" small onClick={nextTheme}>
                Theme: {theme}
              </Button>
              <span class="faint">{info?.version ? `Version ${info.version}` : ''}</span>
            </div>
          </nav>
        </header>
        <div class="content">
          <CameraBar />
          {gone && (
            <Notice kind="problem">The server does not respond. Check that tarsier serve is running.</Notice>
          )}
          {!gone && link === 'waiting' && <Notice>The live connection was lost. Reconnecting ...</Notice>}
          <Body page={now.page} />
        </div>
      </div>
    </>
  );
}

function App() {
  return (
    <>
      <Shell />
      <Toasts />
    </>
  );
}

startRouter();
startKeys();
startLive();
const root = document.getElementById('studio');
if (root) render(<App />, root);

// The link of the terminal carries its token behind the #; it is used once and leaves the address at once.
async function begin(): Promise<void> {
  const token = /^#t=(.+)$/.exec(location.hash)?.[1];
  if (token !== undefined) {
    history.replaceState(null, '', location.pathname + location.search);
    try {
      await api.signIn(decodeURIComponent(token));
      return;
    } catch (problem) {
      signInProblem.value = problem instanceof Error ? problem.message : String(problem);
    }
  }
  await api.session();
}

const start = () =>
  begin().catch(() => {
    setTimeout(() => void start(), 2000);
  });
void start();
