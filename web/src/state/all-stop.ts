// All stop: one request that waits for nothing, and what came of it.
import { signal } from '@preact/signals';
import { get, post } from '../api/client';
import type { DroneCommandStatus } from '../api/types';
import { fleet, reloadFleet } from './fleet';

export interface StopReport {
  at: Date;
  state: 'asked' | 'answered' | 'failed';
  error: unknown;
  /** One for each drone that was armed. */
  commands: DroneCommandStatus[];
}

const OVER = ['done', 'rejected', 'timed_out', 'superseded'];
const ASK_EVERY_MS = 300;
const ASK_FOR_MS = 15_000;
/** Two presses of Escape within this time are meant. */
const TWICE_MS = 600;

export const stopReport = signal<StopReport | null>(null);

export async function allStop(): Promise<void> {
  // What came of it must be seen.
  for (const dialog of document.querySelectorAll('dialog[open]')) dialog.dispatchEvent(new Event('cancel', { cancelable: true }));
  const report: StopReport = { at: new Date(), state: 'asked', error: null, commands: [] };
  stopReport.value = report;
  try {
    const { commands } = await post('/v1/all-stop');
    stopReport.value = { ...report, state: 'answered', commands };
    await follow(report.at, commands);
  } catch (error) {
    if (stopReport.value?.at === report.at) stopReport.value = { ...report, state: 'failed', error };
  }
}

async function follow(at: Date, commands: DroneCommandStatus[]): Promise<void> {
  for (let end = Date.now() + ASK_FOR_MS; Date.now() < end; ) {
    await reloadFleet();
    commands = await Promise.all(commands.map((command) =>
      OVER.includes(command.state)
        ? command
        : get('/v1/drones/{id}/commands/{command}', { at: { id: command.drone, command: command.id } })));
    if (stopReport.value?.at !== at) return;
    stopReport.value = { ...stopReport.value, commands };
    if (commands.every(({ state }) => OVER.includes(state))) return;
    await new Promise((done) => setTimeout(done, ASK_EVERY_MS));
  }
}

/** What a drone did when it was stopped, in words. */
export function stopWords({ drone, state, detail }: DroneCommandStatus): string {
  switch (state) {
    case 'done':
      return fleet.get(drone)?.state?.flying === false ? 'stands, motors off' : 'holds where it is';
    case 'rejected':
      return `REFUSED${detail ? `: ${detail}` : ''}`;
    case 'timed_out':
      return 'DOES NOT ANSWER';
    case 'superseded':
      return 'was given another command';
    default:
      return 'told to stop …';
  }
}

/** Shift+Space, or Escape twice, stops all from every view. */
export function startStopKeys(): void {
  let escapedAt = -Infinity;
  addEventListener('keydown', (event) => {
    if (event.repeat) return;
    const twice = event.key === 'Escape' && event.timeStamp - escapedAt < TWICE_MS;
    if (event.key === 'Escape') escapedAt = twice ? -Infinity : event.timeStamp;
    const typing = event.target instanceof HTMLElement && event.target.matches('input, textarea, select');
    const chord = event.code === 'Space' && event.shiftKey && !typing;
    if (!twice && !chord) return;
    event.preventDefault();
    void allStop();
  }, { capture: true });
}
