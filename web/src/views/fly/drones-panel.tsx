import { useState } from 'preact/hooks';
import { post } from '../../api/client';
import type { DroneCommand } from '../../api/types';
import { colorOf } from '../../map3d/drones';
import {
  batteryOf,
  fleet,
  fleetError,
  fleetKnown,
  fleetTick,
  linkOf,
  nameOf,
  poseOf,
  tookCommand,
  type Level,
  type LiveDrone,
} from '../../state/fleet';
import { toastError } from '../../state/toasts';
import { Empty } from '../../ui/empty';
import { Failure } from '../../ui/failure';
import { Icon } from '../../ui/icons';
import type { Desk } from './desk';
import { RegisterDrone } from './register-drone';

const WORDS: Record<string, string> = {
  arm: 'Arm', disarm: 'Disarm', takeoff: 'Take off', goto: 'Go to', hold: 'Hold', land: 'Land', stop: 'Stop',
};
/** Commands by number, as this page gave them. */
const given = new Map<number, string>();

export function DronesPanel({ desk }: { desk: Desk }) {
  fleetTick.value;
  const [registering, setRegistering] = useState<LiveDrone | null>(null);
  if (!fleetKnown.value) return <p class="muted">Loading …</p>;
  if (fleetError.value) return <Failure error={fleetError.value} />;
  if (fleet.size === 0) {
    return (
      <Empty title="No drone is heard" icon="fly">
        <p>Drones are found by their heartbeats. Start the ground station with <code>--mavlink</code> and let drones send to that address.</p>
      </Empty>
    );
  }
  return (
    <>
      <ul class="drones">
        {[...fleet.values()].sort((a, b) => a.drone.id - b.drone.id).map((live) => (
          <DroneCard key={live.drone.id} desk={desk} live={live} register={() => setRegistering(live)} />
        ))}
      </ul>
      {registering && <RegisterDrone live={registering} onClose={() => setRegistering(null)} />}
    </>
  );
}

function DroneCard({ desk, live, register }: { desk: Desk; live: LiveDrone; register: () => void }) {
  const { drone, state } = live;
  const chosen = desk.chosen.value === drone.id;
  const tell = async (command: DroneCommand) => {
    try {
      const status = await post('/v1/drones/{id}/commands', command, { at: { id: drone.id } });
      given.set(status.id, command.type);
      tookCommand(status);
    } catch (error) {
      toastError(error);
    }
  };
  const button = (type: 'arm' | 'disarm' | 'hold' | 'land') => (
    <button type="button" disabled={!state} onClick={() => void tell({ type })}>
      {WORDS[type]}
    </button>
  );
  const battery = batteryOf(live);
  const named = drone.name !== null && drone.name !== undefined;
  return (
    <li class={`drone ${chosen ? 'chosen' : ''}`} data-drone={drone.id}>
      <div class="row">
        <button type="button" class="drone-name" aria-pressed={chosen} onClick={() => (desk.chosen.value = drone.id)}>
          <span class="swatch" style={{ background: colorOf(drone.id) }} />
          {nameOf(drone.id)}
        </button>
        <span class="grow" />
        <button
          type="button"
          class={named ? 'quiet icon-only' : 'quiet'}
          aria-label={`${named ? 'Settings of' : 'Register'} ${nameOf(drone.id)}`}
          title="Name and camera"
          onClick={register}
        >
          <Icon name={named ? 'edit' : 'plus'} /> {!named && 'Register'}
        </button>
      </div>
      <div class="row facts num">
        <Fact {...linkOf(live)} />
        {state && <Fact {...poseOf(live)} />}
        {battery && <Fact {...battery} />}
        {state?.failsafe && <Fact level="bad" words="failsafe" />}
      </div>
      {state && <p class="muted num state-words">{stateWords(live)}</p>}
      <div class="row commands">
        {state?.flying ? [button('hold'), button('land')] : [
          button(state?.armed ? 'disarm' : 'arm'),
          <button type="button" disabled={!state} onClick={() => void tell({ type: 'takeoff', height: desk.height.value })}>
            {WORDS.takeoff}, {desk.height.value} m
          </button>,
        ]}
      </div>
      {live.command && <CommandState live={live} />}
    </li>
  );
}

function stateWords({ state }: LiveDrone): string {
  if (!state) return '';
  const parts = [state.flying ? 'flying' : state.armed ? 'armed' : 'on the ground'];
  if (state.mode && state.mode !== 'other') parts.push(state.mode);
  parts.push(state.autopilot === 'px4' ? 'PX4' : 'ArduPilot');
  if (state.estimate) parts.push(`at ${state.estimate.position.map((value) => value.toFixed(1)).join(', ')} m`);
  return parts.join(' · ');
}

/** Level by a sign and words, too, not by color alone. */
function Fact({ level, words }: { level: Level; words: string }) {
  return (
    <span class={`badge ${level}`}>
      {level !== 'good' && <Icon name="warn" size={12} />}
      {words}
    </span>
  );
}

const COMMAND_LEVELS: Record<string, string> = { done: 'good', rejected: 'bad', timed_out: 'bad', superseded: '' };

function CommandState({ live }: { live: LiveDrone }) {
  const command = live.command!;
  const what = given.get(command.id);
  return (
    <p class="command" role="status">
      {WORDS[what ?? ''] ?? 'Command'}:{' '}
      <span class={`badge ${COMMAND_LEVELS[command.state] ?? 'info'}`}>{command.state.replaceAll('_', ' ')}</span>{' '}
      {command.detail}
    </p>
  );
}
