import { signal } from '@preact/signals';

// A page path: "/session/ab12?wide=1" is page "session", rest ["ab12"], query wide=1.
export interface Route {
  page: string;
  rest: string[];
  query: URLSearchParams;
}

export const PAGES = [
  '',
  'live',
  'session',
  'plates',
  'people',
  'reconstruct',
  'annotate',
  'calibrate',
  'train',
  'explore',
  'system',
  'api',
] as const;

function decode(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

export function parseRoute(address: string): Route {
  const hash = address.indexOf('#');
  const whole = hash < 0 ? address : address.slice(0, hash);
  const mark = whole.indexOf('?');
  const path = mark < 0 ? whole : whole.slice(0, mark);
  const parts = path
    .split('/')
    .filter((part) => part !== '')
    .map(decode);
  const page = parts[0] ?? '';
  const known = (PAGES as readonly string[]).includes(page) && (page !== 'session' || parts.length === 2);
  return {
    page: known ? page : 'missing',
    rest: parts.slice(1),
    query: new URLSearchParams(mark < 0 ? '' : whole.slice(mark + 1)),
  };
}

const here = () => (typeof location === 'undefined' ? '/' : location.pathname + location.search);

export const route = signal<Route>(parseRoute(here()));

export function navigate(address: string, replace = false): void {
  if (replace) history.replaceState(null, '', address);
  else history.pushState(null, '', address);
  route.value = parseRoute(address);
  if (!replace) window.scrollTo(0, 0);
}

// The address of a link that the page follows itself, or null where the browser should.
export function ownAddress(
  event: Pick<MouseEvent, 'button' | 'ctrlKey' | 'metaKey' | 'shiftKey' | 'altKey' | 'defaultPrevented'>,
  link: { href: string; target: string; download: string },
  origin: string,
): string | null {
  if (event.defaultPrevented || event.button !== 0) return null;
  if (event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return null;
  if (link.target !== '' || link.download !== '') return null;
  const url = new URL(link.href);
  if (url.origin !== origin || url.pathname.startsWith('/api/') || url.pathname.startsWith('/assets/'))
    return null;
  if (url.pathname === '/metrics' || url.pathname === '/healthz') return null;
  return url.pathname + url.search;
}

export function startRouter(): void {
  window.addEventListener('popstate', () => {
    route.value = parseRoute(here());
  });
  document.addEventListener('click', (event) => {
    const link = event.target instanceof Element ? event.target.closest('a') : null;
    if (!link || !link.href || link.getAttribute('href')?.startsWith('#')) return;
    const address = ownAddress(event, link, location.origin);
    if (address === null) return;
    event.preventDefault();
    navigate(address);
  });
}
