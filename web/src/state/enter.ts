// Entering and leaving the service.
import { ApiError, get } from '../api/client';
import { disconnect } from '../api/socket';
import { keepToken, session } from './session';

const AGAIN_MS = 3000;

/** Asks the service whether it takes us, with or without a token; tries on while it is silent. */
export async function enter(): Promise<void> {
  try {
    session.info.value = await get('/v1/info');
    session.reason.value = null;
    session.state.value = 'open';
  } catch (error) {
    if (error instanceof ApiError && error.problem.status === 401) return;
    session.reason.value = error instanceof Error ? error.message : String(error);
    session.state.value = 'unreachable';
    setTimeout(() => void enter(), AGAIN_MS);
  }
}

export function enterWith(token: string): Promise<void> {
  disconnect();
  keepToken(token);
  session.state.value = 'checking';
  return enter();
}

export function leave(): void {
  disconnect();
  keepToken(null);
  session.reason.value = null;
  session.state.value = 'checking';
  void enter();
}
