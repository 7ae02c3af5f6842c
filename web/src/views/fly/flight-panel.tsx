import { useEffect } from 'preact/hooks';
import { explain } from '../../api/client';
import { subscribe } from '../../api/socket';
import type { Flight, FlightLeg, Target } from '../../api/types';
import { colorOf } from '../../map3d/drones';
import { fleet, fleetTick, nameOf } from '../../state/fleet';
import { toastError } from '../../state/toasts';
import { Icon } from '../../ui/icons';
import type { Check, Desk } from './desk';

const FOLLOW_MS = 500;
const DEG = 180 / Math.PI;

export function FlightPanel({ desk }: { desk: Desk }) {
  fleetTick.value;
  const flight = desk.flight.value;
  return (
    <>
      {!desk.active.value && <Targets desk={desk} />}
      {desk.refusal.value !== null && <Refused error={desk.refusal.value} />}
      {desk.target.value && <TargetCard desk={desk} target={desk.target.value} />}
      {flight && <FlightCard key={flight.id} desk={desk} flight={flight} />}
    </>
  );
}

function Targets({ desk }: { desk: Desk }) {
  const aims = desk.aims.value;
  const ids = [...fleet.keys()].sort((a, b) => a - b);
  const shown = (id: number) => id === desk.chosen.value || aims.some((aim) => aim.drone === id);
  const option = (words: string, signal: Desk['speed'], min: number, step: number) => (
    <label class="grow">
      {words}
      <input
        type="number"
        min={min}
        step={step}
        value={signal.value}
        onChange={(event) => {
          const value = event.currentTarget.valueAsNumber;
          if (value >= min) signal.value = value;
          desk.forgetPlan();
        }}
      />
    </label>
  );
  return (
    <>
      <fieldset class="targets">
        <legend>Targets in the map, meters</legend>
        {ids.filter(shown).map((id) => <Target key={id} desk={desk} id={id} />)}
        <div class="row">
          {ids.filter((id) => !shown(id)).map((id) => (
            <button key={id} type="button" onClick={() => (desk.chosen.value = id)}>
              <span class="swatch" style={{ background: colorOf(id) }} /> {nameOf(id)}
            </button>
          ))}
        </div>
      </fieldset>
      <div class="row">
        {option('Height, m', desk.height, 0.2, 0.1)}
        {option('Apart, m', desk.separation, 0.2, 0.1)}
        {option('Speed, m/s', desk.speed, 0.1, 0.1)}
      </div>
      {aims.length > 1 && (
        <label class="check">
          <input
            type="checkbox"
            checked={desk.exchange.value}
            onChange={(event) => {
              desk.exchange.value = event.currentTarget.checked;
              desk.forgetPlan();
            }}
          />
          Drones may exchange their targets
        </label>
      )}
      <button type="button" class={desk.flight.value || desk.target.value ? '' : 'primary'} disabled={aims.length === 0 || desk.busy.value} onClick={() => void desk.plan()}>
        <Icon name="target" /> {desk.busy.value ? 'Planning …' : 'Plan and check'}
      </button>
      <p class="muted">Nothing flies before you press Fly. Others in the air stay where they are.</p>
    </>
  );
}

function Target({ desk, id }: { desk: Desk; id: number }) {
  const aim = desk.aims.value.find((aim) => aim.drone === id);
  const chosen = desk.chosen.value === id;
  const values = aim ? [...aim.position, aim.yaw === null ? NaN : aim.yaw * DEG] : [];
  const set = (k: number, value: number) => {
    const estimate = fleet.get(id)?.state?.estimate?.position ?? [0, 0, 0];
    const [x = 0, y = 0, z = 0] = aim?.position ?? [estimate[0] ?? 0, estimate[1] ?? 0, desk.floor + desk.height.value];
    const place: [number, number, number] = [x, y, z];
    let yaw = aim?.yaw ?? null;
    if (k === 3) yaw = Number.isNaN(value) ? null : value / DEG;
    else if (!Number.isNaN(value)) place[k] = value;
    desk.chosen.value = id;
    desk.aim(id, place, yaw);
  };
  return (
    <div class={`target ${chosen ? 'chosen' : ''}`} data-target={id}>
      <button type="button" class="drone-name" aria-pressed={chosen} onClick={() => (desk.chosen.value = id)}>
        <span class="swatch" style={{ background: colorOf(id) }} />
        {nameOf(id)}
      </button>
      {['x', 'y', 'z', 'yaw °'].map((axis, k) => {
        const value = values[k];
        return (
          <label key={axis}>
            <span class="field-help">{axis}</span>
            <input
              type="number"
              step={k === 3 ? 5 : 0.1}
              aria-label={`${axis} of ${nameOf(id)}`}
              placeholder={k === 3 ? 'free' : '–'}
              value={value === undefined || Number.isNaN(value) ? '' : Math.round(value * 100) / 100}
              onChange={(event) => set(k, event.currentTarget.valueAsNumber)}
            />
          </label>
        );
      })}
      <button type="button" class="quiet icon-only" aria-label={`No target for ${nameOf(id)}`} disabled={!aim} onClick={() => desk.aim(id, null)}>
        <Icon name="close" />
      </button>
    </div>
  );
}

function Refused({ error }: { error: unknown }) {
  const { text, code, hint } = explain(error);
  return (
    <div class="note bad" role="alert">
      <Icon name="warn" />
      <div>
        <p><strong>This does not fly.</strong> {code && <code>{code}</code>}</p>
        <ul>{text.split('; ').map((reason) => <li key={reason}>{reason}</li>)}</ul>
        {hint && <p class="muted">{hint}</p>}
      </div>
    </div>
  );
}

/** What the service checked, in words; what it says of a rule that is broken is its own. */
const PASSED: Record<string, string> = {
  map_metric: 'The map is in meters',
  geofence: 'Inside the fence',
  free_space: 'All of the way is seen and free',
  separation: 'Apart from all others in the air',
  limits: 'Not too fast',
  drone: 'The drone can be steered',
};

/** One drone that hovers, and the way to its target. */
function TargetCard({ desk, target }: { desk: Desk; target: Target }) {
  const checks = target.checks.map(({ rule, state, detail }): Check => {
    if (state === 'passed') return { level: 'good', words: PASSED[rule] ?? rule };
    if (state === 'failed') return { level: 'bad', words: detail ?? rule };
    return { level: 'warn', words: 'The map says nothing about free space: look at the way yourself' };
  });
  const { turn } = target;
  return (
    <section class="stack flight" aria-label="Flight">
      <div class="row">
        <h2>Planned</h2>
        <span class="num muted">
          {turn != null && `${Math.abs(turn * DEG).toFixed(0)}° ${turn < 0 ? 'right' : 'left'} of its front, `}
          {target.duration_s.toFixed(1)} s
        </span>
      </div>
      <Checks checks={checks} />
      <button type="button" class="primary" disabled={desk.busy.value || checks.some(({ level }) => level === 'bad')} onClick={() => void desk.flyTarget()}>
        <Icon name="play" /> Fly
      </button>
      <Legs ways={[{ id: target.drone, legs: target.legs }]} clock={null} />
    </section>
  );
}

function FlightCard({ desk, flight }: { desk: Desk; flight: Flight }) {
  const { active } = desk;
  useEffect(() => {
    const follow = () => void desk.follow().catch(() => {});
    const end = subscribe(`flight:${flight.id}`, follow);
    const timer = setInterval(() => active.value && follow(), FOLLOW_MS);
    return () => {
      end();
      clearInterval(timer);
    };
  }, []);
  const wish = (what: 'start' | 'pause' | 'resume' | 'abort') => void desk.wish(what).catch(toastError);
  const over = flight.state === 'finished' || flight.state === 'aborted';
  const checks = flight.state === 'ready' && !flight.taking_off ? desk.checks(flight) : [];
  const blocked = checks.some(({ level }) => level === 'bad');
  return (
    <section class="stack flight" aria-label="Flight">
      <div class="row">
        <h2>{titleOf(flight)}</h2>
        <span class="num muted">
          {flight.clock_s.toFixed(1)} / {flight.duration_s.toFixed(1)} s
        </span>
      </div>
      <progress aria-label="Time on the plan" max={flight.duration_s || 1} value={over ? flight.duration_s : flight.clock_s} />
      {flight.clock_held_by !== null && flight.clock_held_by !== undefined && active.value && (
        <p class="note warn"><Icon name="pause" /> The clock of all waits for {nameOf(flight.clock_held_by)}</p>
      )}
      <Checks checks={checks} />
      {flight.state === 'ready' && !flight.taking_off && (
        <button type="button" class="primary" disabled={blocked} onClick={() => wish('start')}>
          <Icon name="play" /> Fly
        </button>
      )}
      {active.value && (
        <div class="row">
          {flight.state === 'paused'
            ? <button type="button" onClick={() => wish('resume')}><Icon name="play" /> Resume</button>
            : <button type="button" disabled={flight.taking_off} onClick={() => wish('pause')}><Icon name="pause" /> Pause</button>}
          <button type="button" onClick={() => wish('abort')}><Icon name="stop" /> Abort and land</button>
        </div>
      )}
      <Legs ways={flight.drones} clock={flight.state === 'running' ? flight.clock_s : null} />
      {flight.events.length > 0 && <News flight={flight} />}
      {over && <button type="button" onClick={() => { desk.aims.value = []; desk.forgetPlan(); }}>New flight</button>}
    </section>
  );
}

function titleOf({ state, taking_off }: Flight): string {
  if (taking_off) return 'Taking off';
  return { ready: 'Planned', running: 'Flying', paused: 'Paused', finished: 'Arrived', aborted: 'Aborted' }[state] ?? state;
}

function Checks({ checks }: { checks: Check[] }) {
  if (checks.length === 0) return null;
  return (
    <ul class="checks" aria-label="Checks">
      {checks.map(({ level, words }) => (
        <li key={words} class={level}>
          <Icon name={level === 'good' ? 'check' : 'warn'} />
          {words}
        </li>
      ))}
    </ul>
  );
}

interface WayRows {
  id: number;
  legs: readonly FlightLeg[];
  taken_out?: boolean;
}

/** `clock`: seconds on the plan that is flown. */
function Legs({ ways, clock }: { ways: readonly WayRows[]; clock: number | null }) {
  return (
    <table class="legs num">
      <thead>
        <tr><th>Drone</th><th>Leg</th><th>Seconds</th><th>To</th></tr>
      </thead>
      <tbody>
        {ways.flatMap(({ id, legs, taken_out }) => {
          const rows = legs.length > 0 ? legs : [null];
          return rows.map((leg, k) => {
            const now = leg && clock !== null && clock >= leg.start_s && clock < leg.end_s;
            return (
              <tr key={`${id}/${k}`} aria-current={now ? 'step' : undefined}>
                <td>{k === 0 && <><span class="swatch" style={{ background: colorOf(id) }} /> {nameOf(id)}{taken_out && ' (out)'}</>}</td>
                <td>{leg ? leg.kind : 'stays'}</td>
                <td>{leg ? `${leg.start_s.toFixed(1)}–${leg.end_s.toFixed(1)}` : ''}</td>
                <td>{leg?.to.map((value) => value.toFixed(1)).join(', ')}</td>
              </tr>
            );
          });
        })}
      </tbody>
    </table>
  );
}

function News({ flight }: { flight: Flight }) {
  const latest = flight.events.slice(-6).reverse();
  return (
    <ol class="news" aria-label="What happened, newest first">
      {latest.map(({ t_ns, kind, drone, value }) => (
        <li key={`${t_ns}/${kind}/${drone}`}>
          <time class="num muted">{new Date(t_ns / 1e6).toLocaleTimeString()}</time>{' '}
          {drone !== null && drone !== undefined ? `${nameOf(drone)}: ` : ''}{kind.replaceAll('_', ' ')}{value ? ` ${value.replaceAll('_', ' ')}` : ''}
        </li>
      ))}
    </ol>
  );
}
