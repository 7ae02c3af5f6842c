// Who we are to the service: the token lives in this tab only.
import { signal } from '@preact/signals';
import type { Info } from '../api/types';

const KEY = 'volery.token';

export const session = {
  token: signal<string | null>(sessionStorage.getItem(KEY)),
  state: signal<'checking' | 'open' | 'locked' | 'unreachable'>('checking'),
  /** Why it is locked, in the service's words. */
  reason: signal<string | null>(null),
  info: signal<Info | null>(null),
};

/** Whether the service has a link to drones. */
export const hasDrones = (): boolean => session.info.value?.capabilities.mavlink ?? false;

/** Takes a token from `#token=...` and wipes it from the address bar. */
export function takeTokenFromAddress(): void {
  const fragment = new URLSearchParams(location.hash.slice(1));
  const token = fragment.get('token');
  if (token === null) return;
  fragment.delete('token');
  const rest = fragment.toString();
  history.replaceState(history.state, '', location.pathname + location.search + (rest && `#${rest}`));
  keepToken(token);
}

export function keepToken(token: string | null): void {
  session.token.value = token;
  if (token) sessionStorage.setItem(KEY, token);
  else sessionStorage.removeItem(KEY);
}

/** The service took no token, or not this one. */
export function lock(reason: string): void {
  session.reason.value = session.token.value ? reason : null;
  session.state.value = 'locked';
}
