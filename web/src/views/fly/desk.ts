// What the fly view works on: one map, the chosen drone, its targets, a flight, a fence.
import { computed, signal } from '@preact/signals';
import { Vector3 } from 'three';
import { get, post, put, remove, request } from '../../api/client';
import type { FenceBlock, Flight, Geofence, MapVersion, Target } from '../../api/types';
import type { Aim, Way } from '../../map3d/flight-layers';
import { FreeSpace } from '../../map3d/free-space';
import { vector } from '../../map3d/frames';
import { boundsOf } from '../../map3d/map-layers';
import { fleet } from '../../state/fleet';
import { hasDrones } from '../../state/session';
import { toastError } from '../../state/toasts';

export type Tab = 'drones' | 'flight' | 'fence';
export type Drawing = { kind: 'area' | 'keep_out'; shape: 'box' | 'polygon'; corners: [number, number][] };

/** Room around a drone that the page looks at for things in the way, meters. */
const BODY_RADIUS_M = 0.2;
/** Distance to walls that a new fence starts with; the service keeps it where there is no fence. */
const MARGIN_M = 0.5;

/** Distance of a target to a wall that was clicked, meters. */
const WALL_M = 1;

export interface Check {
  level: 'good' | 'warn' | 'bad';
  words: string;
}

export class Desk {
  readonly tab = signal<Tab>('drones');
  readonly chosen = signal<number | null>(null);
  readonly aims = signal<readonly Aim[]>([]);
  /** Height above the floor of targets that are clicked, meters. */
  readonly height = signal(1.2);
  readonly separation = signal(1);
  readonly speed = signal(0.5);
  readonly exchange = signal(false);
  /** Planned or flying. */
  readonly flight = signal<Flight | null>(null);
  /** The way of one drone in the air to its target, not flown yet. */
  readonly target = signal<Target | null>(null);
  /** What is drawn. */
  readonly ways = computed<readonly Way[]>(() => {
    const target = this.target.value;
    if (target) return [{ id: target.drone, start: target.start.position, legs: target.legs }];
    return this.flight.value?.drones ?? [];
  });
  readonly refusal = signal<unknown>(null);
  readonly busy = signal(false);
  /** As the service has it; `null`: none. */
  readonly fence = signal<Geofence | null>(null);
  /** Being changed, not yet saved. */
  readonly draft = signal<Geofence | null>(null);
  readonly drawing = signal<Drawing | null>(null);
  readonly air = signal<FreeSpace | null>(null);
  readonly active = computed(() => {
    const flight = this.flight.value;
    return flight !== null && (flight.taking_off || flight.state === 'running' || flight.state === 'paused');
  });
  readonly floor: number;
  readonly mapId: string;

  constructor(readonly version: MapVersion) {
    this.mapId = version.map_id;
    const bounds = boundsOf(version);
    this.floor = bounds.isEmpty() ? 0 : bounds.min.z;
  }

  /** Fence, free space, and the flight that is on, if there is one. */
  async load(signal: AbortSignal): Promise<void> {
    const at = { id: this.mapId };
    // Maps without a dense cloud say nothing about free space.
    const seesAir = this.version.files.some(({ path }) => path === 'freespace.bin');
    await Promise.all([
      get('/v1/geofences', { signal }).then((fences) => {
        this.fence.value = fences.find((fence) => fence.map_id === this.mapId) ?? null;
      }),
      seesAir && request('GET', '/v1/maps/{id}/freespace', null, { at, query: { version: this.version.version }, signal })
        .then(async (answer) => (this.air.value = new FreeSpace(await answer.arrayBuffer()))),
      hasDrones() && get('/v1/flights', { signal }).then((flights) => {
        const mine = flights.filter((flight) => flight.map_id === this.mapId);
        this.flight.value = mine.findLast((flight) => flight.taking_off || flight.state === 'running' || flight.state === 'paused') ?? null;
      }),
    ]);
  }

  /** Sets the target of a drone; without a place, takes it away. */
  aim(drone: number, position: readonly [number, number, number] | null, yaw: number | null = null): void {
    const others = this.aims.value.filter((aim) => aim.drone !== drone);
    this.aims.value = position ? [...others, { drone, position, yaw }].sort((a, b) => a.drone - b.drone) : others;
    this.forgetPlan();
  }

  /** A place that was clicked as a target: above it, and before a wall. */
  aimAt(place: Vector3, normal: Vector3 | null): void {
    const drone = this.chosen.value ?? [...fleet.keys()][0];
    if (drone === undefined || this.active.value) return;
    this.chosen.value = drone;
    const wall = normal !== null && Math.abs(normal.z) < 0.7;
    const at = wall ? place.clone().addScaledVector(normal.clone().setZ(0).normalize(), WALL_M) : place;
    const round = (value: number) => Math.round(value * 100) / 100;
    this.aim(drone, [round(at.x), round(at.y), round(this.floor + this.height.value)]);
    this.tab.value = 'flight';
  }

  /** A plan is for the targets it was made with. */
  forgetPlan(): void {
    const old = this.flight.value;
    if (this.active.value) return;
    this.flight.value = null;
    this.target.value = null;
    this.refusal.value = null;
    if (old?.state === 'ready') void this.wish('abort', old).catch(() => {});
  }

  async plan(): Promise<void> {
    this.forgetPlan();
    const [aim, ...others] = this.aims.value;
    await this.during(async () => {
      if (aim && others.length === 0 && fleet.get(aim.drone)?.state?.flying) {
        this.target.value = await this.flyTo(aim, true);
        return;
      }
      this.flight.value = await post('/v1/flights', {
        map_id: this.mapId,
        drones: this.crew(),
        separation_m: this.separation.value,
        speed: this.speed.value,
        exchange_goals: this.exchange.value,
      });
    });
  }

  /** Flies the way that was shown, as it is planned from where the drone is now. */
  async flyTarget(): Promise<void> {
    const [aim] = this.aims.value;
    if (!aim) return;
    await this.during(async () => {
      const { flight_id: id } = await this.flyTo(aim, false);
      this.target.value = null;
      if (id) this.flight.value = await get('/v1/flights/{id}', { at: { id } });
    });
  }

  private flyTo({ drone, position, yaw }: Aim, dry_run: boolean): Promise<Target> {
    const [speed, separation_m] = [this.speed.value, this.separation.value];
    const body = { map_id: this.mapId, position: [...position], yaw, speed, separation_m, dry_run };
    return post('/v1/drones/{id}/target', body, { at: { id: drone } });
  }

  /** Those with targets, and those in the air, who stay where they are. */
  private crew() {
    return [...fleet.values()].flatMap(({ drone, state }) => {
      const aim = this.aims.value.find((aim) => aim.drone === drone.id);
      if (!aim && !state?.flying) return [];
      const [x, y, z] = state?.estimate?.position ?? [];
      const up = !state?.flying && x !== undefined && y !== undefined && z !== undefined;
      return [{
        id: drone.id,
        ...(up && { start: { position: [x, y, z + this.height.value] } }),
        goals: aim ? [{ position: [...aim.position], ...(aim.yaw !== null && { yaw: aim.yaw }) }] : [],
      }];
    });
  }

  async wish(what: 'start' | 'pause' | 'resume' | 'abort', flight = this.flight.value): Promise<void> {
    if (!flight) return;
    const answer = await post(`/v1/flights/{id}/${what}`, undefined, { at: { id: flight.id } });
    if (this.flight.value?.id === flight.id) this.flight.value = answer;
  }

  async follow(): Promise<void> {
    const flight = this.flight.value;
    if (!flight) return;
    const now = await get('/v1/flights/{id}', { at: { id: flight.id } });
    if (this.flight.value?.id === now.id) this.flight.value = now;
  }

  private async during(work: () => Promise<void>): Promise<void> {
    this.busy.value = true;
    try {
      await work();
    } catch (error) {
      this.refusal.value = error;
    }
    this.busy.value = false;
  }

  /** What the plan was checked for, in words. */
  checks(flight: Flight): Check[] {
    const checks: Check[] = [{ level: 'good', words: this.fence.value ? 'Inside the fence' : 'Inside the bounds of the map, 0.5 m from them' }];
    const { closest_m } = flight;
    if (closest_m !== null && closest_m !== undefined) {
      checks.push({ level: 'good', words: `Nearest approach ${closest_m.toFixed(2)} m, at least ${this.separation.value} m wanted` });
    }
    checks.push(this.airCheck(flight));
    return checks;
  }

  private airCheck(flight: Flight): Check {
    const air = this.air.value;
    if (!air) return { level: 'warn', words: 'The map says nothing about free space: look at the ways yourself' };
    let unseen: string | null = null;
    for (const { id, start, legs } of flight.drones) {
      let from = vector(start);
      for (const leg of legs) {
        const to = vector(leg.to);
        const worst = air.along(from, to, BODY_RADIUS_M);
        const place = worst.place ? worst.place.toArray().map((v) => v.toFixed(1)).join(', ') : '';
        if (worst.air === 'occupied') {
          return { level: 'bad', words: `Drone ${id} comes within ${BODY_RADIUS_M} m of a thing at (${place})` };
        }
        if (worst.air === 'unseen') unseen ??= `Drone ${id} flies through air that no photo shows, at (${place})`;
        from = to;
      }
    }
    return unseen ? { level: 'warn', words: unseen } : { level: 'good', words: 'All of the way is seen and free' };
  }

  /** The fence that applies without one: the bounds of the map. */
  blank(): Geofence {
    const { min, max } = boundsOf(this.version);
    const outline = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]];
    return { map_id: this.mapId, area: { outline, floor: min.z, ceiling: max.z }, keep_out: [], margin_m: MARGIN_M };
  }

  saveFence = (fence: Geofence): Promise<void> => this.setFence(put('/v1/geofences', fence));

  deleteFence = (): Promise<void> =>
    this.setFence(remove('/v1/geofences/{id}', { at: { id: this.mapId } }).then(() => null));

  private async setFence(answer: Promise<Geofence | null>): Promise<void> {
    try {
      this.fence.value = await answer;
      this.draft.value = null;
      this.forgetPlan();
    } catch (error) {
      toastError(error);
    }
  }

  /** A corner of what is being drawn. */
  corner(x: number, y: number): void {
    const drawing = this.drawing.value;
    if (!drawing) return;
    const corners: [number, number][] = [...drawing.corners, [Math.round(x * 100) / 100, Math.round(y * 100) / 100]];
    this.drawing.value = { ...drawing, corners };
    if (drawing.shape === 'box' && corners.length === 2) this.closeOutline();
  }

  closeOutline(): void {
    const drawing = this.drawing.value;
    const outline = drawing && outlineOf(drawing);
    if (!drawing || !outline) return;
    const fence = this.draft.value ?? this.fence.value ?? this.blank();
    const block: FenceBlock = { ...fence.area, outline };
    this.draft.value = drawing.kind === 'area'
      ? { ...fence, area: block }
      : { ...fence, keep_out: [...(fence.keep_out ?? []), block] };
    this.drawing.value = null;
  }
}

export function outlineOf({ shape, corners }: Drawing): number[][] | null {
  if (shape === 'polygon') return corners.length >= 3 ? corners : null;
  const [a, b] = corners;
  return a && b ? [[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]] : null;
}
