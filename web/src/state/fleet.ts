// Drones as they are now. Messages of twenty drones come two hundred times a second: they are kept
// in place, lists look at them five times a second, and scenes before each picture.
import { signal } from '@preact/signals';
import { get } from '../api/client';
import { subscribe, type ServerMessage } from '../api/socket';
import type { CameraPose, Drone, DroneCommandStatus, DroneState, TrackedFrame } from '../api/types';
import { hasDrones } from './session';

/** What its camera saw last. */
export interface Fix {
  mapId: string;
  frame: TrackedFrame;
  /** When the frame was taken, on the clock of the page. */
  takenAt: number;
}

export interface LiveDrone {
  drone: Drone;
  state: DroneState | null;
  /** When `state` came, on the clock of the page. */
  stateAt: number;
  fix: Fix | null;
  /** Pictures of its camera come. */
  films: boolean;
  /** The newest command. */
  command: DroneCommandStatus | null;
}

export type Level = 'good' | 'warn' | 'bad';

/** Poses that are older hold a drone. */
export const STALE_MS = 500;
/** A link without a heartbeat for longer is shown as lost even if nobody says so. */
const SILENT_MS = 3000;
const LOW_BATTERY = 0.2;
const LIST_EVERY_MS = 200;
const ASK_EVERY_MS = 2000;

const drones = new Map<number, LiveDrone>();
const listeners = new Set<() => void>();
let due = false;

/** Drones by system id; read it where `fleetTick` or `onFleet` is followed. */
export const fleet: ReadonlyMap<number, LiveDrone> = drones;
/** Rises five times a second at most. */
export const fleetTick = signal(0);
/** Why there are no drones. */
export const fleetError = signal<unknown>(null);
/** Whether the list has come once. */
export const fleetKnown = signal(false);

/** Calls `listener` with every change. */
export function onFleet(listener: () => void): () => void {
  listeners.add(listener);
  return () => void listeners.delete(listener);
}

export const nameOf = (id: number): string => drones.get(id)?.drone.name ?? `Drone ${id}`;

function changed(): void {
  for (const call of listeners) call();
  if (due) return;
  due = true;
  setTimeout(() => {
    due = false;
    fleetTick.value += 1;
  }, LIST_EVERY_MS);
}

function entry(drone: Drone): LiveDrone {
  let live = drones.get(drone.id);
  if (!live) {
    live = { drone, state: null, stateAt: 0, fix: null, films: false, command: null };
    drones.set(drone.id, live);
  }
  return live;
}

function takeState(live: LiveDrone, state: DroneState): void {
  if (live.state && state.t_ns < live.state.t_ns) return;
  live.state = state;
  live.stateAt = performance.now();
}

/** Names and settings, and drones that are not heard. */
export async function reloadFleet(): Promise<void> {
  try {
    const items = hasDrones() ? (await get('/v1/drones')).items : [];
    for (const id of drones.keys()) {
      if (!items.some((drone) => drone.id === id)) drones.delete(id);
    }
    for (const drone of items) {
      const live = entry(drone);
      live.drone = drone;
      if (drone.state) takeState(live, drone.state);
    }
    fleetError.value = null;
  } catch (error) {
    fleetError.value = error;
  }
  fleetKnown.value = true;
  changed();
}

export function tookCommand(command: DroneCommandStatus): void {
  const live = drones.get(command.drone);
  if (live && (live.command?.id ?? 0) <= command.id) live.command = command;
  changed();
}

function take(message: ServerMessage): void {
  if (message.type === 'drone.state') {
    const live = drones.get(message.state.id);
    if (live) takeState(live, message.state);
    else void reloadFleet();
  } else if (message.type === 'command.state') {
    tookCommand(message.command);
    return;
  } else if (message.type === 'pose') {
    const live = drones.get(Number(message.drone_id));
    if (!live) return;
    live.films = true;
    const takenAt = performance.now() - message.result.age_ms;
    // Without a pose the last one stays, and ages.
    if (message.result.pose) live.fix = { mapId: message.map_id, frame: message.result, takenAt };
  }
  changed();
}

/** Follows all drones until the returned function is called. */
export function followFleet(): () => void {
  const ends = (hasDrones() ? ['drone:*', 'pose:*'] : []).map((topic) => subscribe(topic, take));
  void reloadFleet();
  const timer = setInterval(() => void reloadFleet(), ASK_EVERY_MS);
  return () => {
    clearInterval(timer);
    for (const end of ends) end();
  };
}

/** How a drone is heard. */
export function linkOf({ state, stateAt }: LiveDrone): { level: Level; words: string } {
  if (!state) return { level: 'bad', words: 'not heard' };
  const silence = state.link.silence_ms + performance.now() - stateAt;
  if (state.link.state === 'lost' || silence > SILENT_MS) {
    return { level: 'bad', words: `lost ${(silence / 1000).toFixed(0)} s` };
  }
  if (state.link.state === 'stale') return { level: 'warn', words: 'link stale' };
  return { level: 'good', words: 'linked' };
}

/** Age of the last pose that its estimator was given, ms; `null` when it has none. */
export function poseAge({ state, stateAt }: LiveDrone): number | null {
  const age = state?.sent_pose_age_ms;
  return age === null || age === undefined ? null : age + performance.now() - stateAt;
}

/** Where its poses come from, and how old the last one is. */
export function poseOf(live: LiveDrone): { level: Level; words: string } {
  const age = poseAge(live);
  if (age === null) return { level: 'warn', words: 'no pose' };
  const seen = live.fix && performance.now() - live.fix.takenAt < 2000 ? live.fix.frame : null;
  const source = seen?.source ?? (seen ? 'camera' : 'fed');
  const old = age > STALE_MS;
  const words = age < 1000 ? `${age.toFixed(0)} ms` : `${(age / 1000).toFixed(0)} s`;
  return old
    ? { level: 'bad', words: `pose stale ${words}` }
    : { level: 'good', words: `pose ${words}, ${source}` };
}

export function batteryOf({ state }: LiveDrone): { level: Level; words: string } | null {
  const charge = state?.battery;
  if (charge === null || charge === undefined) return null;
  const low = charge < LOW_BATTERY;
  return { level: low ? 'bad' : 'good', words: `${low ? 'battery low ' : ''}${Math.round(charge * 100)} %` };
}

/** The pose of its camera, while it is fresh enough to be drawn. */
export function freshFix({ fix }: LiveDrone, mapId: string): { pose: CameraPose; frame: TrackedFrame } | null {
  const pose = fix?.frame.pose;
  if (!fix || !pose || fix.mapId !== mapId) return null;
  return performance.now() - fix.takenAt < 2 * STALE_MS ? { pose, frame: fix.frame } : null;
}
