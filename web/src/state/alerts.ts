// Alerts of drones: one line per drone and kind, the newest first; a line stays until it is
// dismissed.
import { effect } from '@preact/signals';
import { subscribe } from '../api/socket';
import type { DroneAlert } from '../api/types';
import { nameOf } from './fleet';
import { session } from './session';
import { alert, dismiss, type Tone } from './toasts';

/** Lines that the strip holds. */
const MOST = 4;

/** What the codes mean to the one who flies, and how bad it is. */
const WORDS: Record<string, [Tone, string]> = {
  pose_stale: ['bad', 'gets no fresh poses'],
  link_lost: ['bad', 'is not heard any more'],
  lease_over: ['warn', 'lost its pilot: the lease is over'],
  battery_low: ['bad', 'has a low battery'],
  too_close: ['bad', 'came too close to another drone'],
  pose_refused: ['warn', 'was given poses that cannot be'],
  control_taken: ['warn', 'was taken over by another control'],
  not_in_control: ['warn', 'does not follow the ground station'],
  impostor: ['bad', 'is imitated: messages without its signature'],
  shared_address: ['warn', 'shares an address with another drone'],
};

interface Line {
  key: string;
  id: number;
  times: number;
}

let lines: Line[] = [];

function take(event: DroneAlert): void {
  const key = `${event.drone}/${event.code}`;
  const old = lines.find((line) => line.key === key);
  const times = (old?.times ?? 0) + 1;
  const [tone, meaning] = WORDS[event.code] ?? ['warn', event.code.replaceAll('_', ' ')] as const;
  const time = new Date(event.t_ns / 1e6).toLocaleTimeString();
  const text = `${time} ${nameOf(event.drone)} ${meaning}${event.detail ? `: ${event.detail}` : ''}${times > 1 ? ` (${times} times)` : ''}`;
  if (old) dismiss(old.id);
  lines = [{ key, id: alert(tone, text, { code: event.code }), times }, ...lines.filter((line) => line !== old)];
  for (const line of lines.splice(MOST)) dismiss(line.id);
}

/** Listens while the service lets us in. */
export function startAlerts(): void {
  let end: (() => void) | null = null;
  effect(() => {
    end?.();
    end = session.state.value === 'open'
      ? subscribe('alerts', (message) => message.type === 'alert' && take(message.alert))
      : null;
  });
}
