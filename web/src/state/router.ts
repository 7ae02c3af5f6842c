// Addresses of the page. The server answers each of `AREAS` with the page itself.
import { computed, signal } from '@preact/signals';

export const AREAS = ['photos', 'jobs', 'maps', 'fly', 'docs'] as const;
export type Area = (typeof AREAS)[number];

const path = signal(location.pathname);

/** `/maps/4711/x` is `{area: 'maps', rest: ['4711', 'x']}`. */
export const place = computed<{ area: Area | 'start' | null; rest: string[] }>(() => {
  const [first = '', ...rest] = path.value.split('/').filter(Boolean).map(decodeURIComponent);
  if (first === '') return { area: 'start', rest: [] };
  const area = AREAS.find((name) => name === first) ?? null;
  return { area, rest };
});

/** Scroll and focus follow a change of place, as with a new page. */
export function navigate(to: string, how: 'push' | 'replace' = 'push'): void {
  if (how === 'push') history.pushState(null, '', to);
  else history.replaceState(null, '', to);
  path.value = location.pathname;
  scrollTo(0, 0);
}

export function startRouter(): void {
  addEventListener('popstate', () => (path.value = location.pathname));
  document.addEventListener('click', (event) => {
    if (event.defaultPrevented || event.button !== 0) return;
    if (event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
    const link = (event.target as Element).closest?.('a[href^="/"]');
    if (!(link instanceof HTMLAnchorElement) || link.target || link.hasAttribute('download')) return;
    const first = link.pathname.split('/')[1] ?? '';
    if (first !== '' && !AREAS.some((name) => name === first)) return;
    event.preventDefault();
    navigate(link.pathname + link.search + link.hash);
  });
}
