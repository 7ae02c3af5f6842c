// Alerts of drones: one line per drone and kind, with how often and when last. A line goes when its
// cause has gone, or when it is dismissed.
import { effect, signal } from '@preact/signals';
import { subscribe } from '../api/socket';
import type { DroneAlert } from '../api/types';
import { batteryOf, fleet, poseAge, reloadFleet, STALE_MS, type LiveDrone } from './fleet';
import { hasDrones, session } from './session';
import type { Tone } from './toasts';

export interface AlertLine {
  drone: number;
  code: string;
  detail: string | null;
  times: number;
  /** The last time, nanoseconds since the Unix epoch. */
  t_ns: number;
}

/** Lines that the strip holds. */
const MOST = 4;
/** What happened is worth this time of a line at least, nanoseconds. */
const STAY_NS = 4e9;
const LOOK_EVERY_MS = 1000;

/** Each stays where it came in, the newest on top. */
export const alerts = signal<readonly AlertLine[]>([]);

/** What the codes mean to the one who flies, and how bad it is. */
const WORDS: Record<string, [Tone, string]> = {
  pose_stale: ['bad', 'gets no fresh poses'],
  link_lost: ['bad', 'is not heard any more'],
  lease_over: ['warn', 'lost its pilot: the lease is over'],
  battery_low: ['bad', 'has a low battery'],
  too_close: ['bad', 'came too close to another drone'],
  pose_refused: ['warn', 'is given poses that are not believed'],
  control_taken: ['warn', 'was taken over by another control'],
  not_in_control: ['warn', 'does not follow the ground station'],
  impostor: ['bad', 'is imitated: messages without its signature'],
  shared_address: ['warn', 'shares an address with another drone'],
  aborted: ['warn', 'lands: its flight was aborted'],
};

export const meaningOf = ({ code }: AlertLine): [Tone, string] =>
  WORDS[code] ?? ['warn', code.replaceAll('_', ' ')];

const onGround = ({ state }: LiveDrone): boolean => state?.flying === false;
const isControlled = (live: LiveDrone): boolean => onGround(live) || live.state?.in_control === true;
const isFed = (live: LiveDrone): boolean => (poseAge(live) ?? Infinity) < STALE_MS;

/** How the state of a drone shows that a cause has gone; what is not here waits for its reader. */
const GONE: Record<string, (live: LiveDrone) => boolean> = {
  pose_stale: isFed,
  pose_refused: (live) => isFed(live) || onGround(live),
  relocating: isFed,
  relocated: isFed,
  link_lost: ({ state }) => state?.link.state === 'linked',
  battery_low: (live) => batteryOf(live)?.level === 'good',
  lease_over: onGround,
  too_close: onGround,
  aborted: onGround,
  control_taken: isControlled,
  not_in_control: isControlled,
};

const isOf = (a: AlertLine) => (b: { drone: number; code: string }): boolean =>
  a.drone === b.drone && a.code === b.code;

function take({ drone, code, detail = null, t_ns }: DroneAlert): void {
  const line = { drone, code, detail, t_ns, times: 1 };
  const isSame = isOf(line);
  const lines = alerts.value.map((old) => (isSame(old) ? { ...line, times: old.times + 1 } : old));
  alerts.value = lines.some(isSame) ? lines : fitting([line, ...lines]);
  if (!fleet.has(drone)) void reloadFleet();
}

/** Without the oldest line that is not grave, where there are too many. */
function fitting(lines: AlertLine[]): AlertLine[] {
  if (lines.length <= MOST) return lines;
  const least = lines.findLast((line) => meaningOf(line)[0] !== 'bad') ?? lines.at(-1);
  return lines.filter((line) => line !== least);
}

export function dismissAlert(line: AlertLine): void {
  alerts.value = alerts.value.filter((other) => !isOf(line)(other));
}

async function dropGone(): Promise<void> {
  if (alerts.value.length === 0) return;
  await reloadFleet();
  const stays = ({ drone, code, t_ns }: AlertLine): boolean => {
    const live = fleet.get(drone);
    return !live?.state || live.state.t_ns < t_ns + STAY_NS || !GONE[code]?.(live);
  };
  if (!alerts.value.every(stays)) alerts.value = alerts.value.filter(stays);
}

/** Listens while the service lets us in. */
export function startAlerts(): void {
  let end: (() => void) | null = null;
  effect(() => {
    end?.();
    end = session.state.value === 'open' && hasDrones()
      ? subscribe('alerts', (message) => message.type === 'alert' && take(message.alert))
      : null;
  });
  setInterval(() => void dropGone(), LOOK_EVERY_MS);
}
