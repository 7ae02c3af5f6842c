// Planned ways, goals and fences in the scene.
import {
  BufferGeometry,
  DoubleSide,
  Group,
  Line,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  Object3D,
  Quaternion,
  Shape,
  ShapeGeometry,
  SphereGeometry,
  Vector3,
} from 'three';
import type { FenceBlock, FlightLeg, Geofence } from '../api/types';
import { colorOf } from './drones';
import { UP, vector } from './frames';
import type { MapScene } from './scene';

const AREA = 0x1b8f4d;
const KEEP_OUT = 0xc4161c;

function put(scene: MapScene, layer: string, objects: Object3D[]): void {
  scene.clear(layer);
  for (const object of objects) {
    object.traverse((part) => (part.raycast = () => {}));
    scene.layer(layer).add(object);
  }
  scene.invalidate();
}

/** A ball where a drone shall go, and an arm where it shall look. */
function goal(position: readonly number[], yaw: number | null, color: string): Object3D {
  const group = new Group();
  const ball = new Mesh(new SphereGeometry(0.09, 20, 14), new MeshBasicMaterial({ color, transparent: true, opacity: 0.85 }));
  group.add(ball);
  if (yaw !== null) group.add(lines([new Vector3(), new Vector3(0.4, 0, 0)], color));
  group.position.copy(vector(position));
  group.quaternion.copy(new Quaternion().setFromAxisAngle(UP, yaw ?? 0));
  return group;
}

const lines = (points: Vector3[], color: string | number) =>
  new Line(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ color }));

export interface Aim {
  drone: number;
  position: readonly number[];
  yaw: number | null;
}

/** Targets that are wished, with the line down to the floor. */
export function showAims(scene: MapScene, aims: readonly Aim[], floor: number): void {
  put(scene, 'aims', aims.flatMap(({ drone, position, yaw }) => {
    const [x = 0, y = 0, z = 0] = position;
    return [
      goal(position, yaw, colorOf(drone)),
      lines([new Vector3(x, y, z), new Vector3(x, y, floor)], colorOf(drone)),
    ];
  }));
}

/** The planned way of a drone. */
export interface Way {
  id: number;
  start: readonly number[];
  legs: readonly FlightLeg[];
}

/** The legs of a plan: a line each, with a mark where a leg ends. */
export function showPlan(scene: MapScene, ways: readonly Way[]): void {
  put(scene, 'plan', ways.flatMap(({ id, start, legs }) => {
    const color = colorOf(id);
    const places = [start, ...legs.map((leg) => leg.to)].map(vector);
    const stops = new Mesh(new SphereGeometry(0.04, 12, 8), new MeshBasicMaterial({ color }));
    return [lines(places, color), ...places.map((place) => {
      const stop = stops.clone();
      stop.position.copy(place);
      return stop;
    })];
  }));
}

/** Edges of a block, and its floor and ceiling as a haze. */
function block({ outline, floor, ceiling }: FenceBlock, color: number): Object3D {
  const group = new Group();
  const ring = (z: number) => outline.map(([x = 0, y = 0]) => new Vector3(x, y, z));
  const low = ring(floor);
  const high = ring(ceiling);
  const edges: Vector3[] = [];
  const walls: number[] = [];
  low.forEach((corner, k) => {
    const next = (k + 1) % low.length;
    edges.push(corner, low[next]!, high[k]!, high[next]!, corner, high[k]!);
    walls.push(k, next, low.length + k, next, low.length + next, low.length + k);
  });
  const haze = new MeshBasicMaterial({ color, transparent: true, opacity: 0.07, side: DoubleSide, depthWrite: false });
  group.add(
    new LineSegments(new BufferGeometry().setFromPoints(edges), new LineBasicMaterial({ color })),
    new Mesh(new BufferGeometry().setFromPoints([...low, ...high]).setIndex(walls), haze),
  );
  if (outline.length >= 3) {
    const flat = new Shape();
    flat.setFromPoints(low as never);
    const ground = new Mesh(new ShapeGeometry(flat), haze);
    ground.position.z = floor;
    group.add(ground);
  }
  return group;
}

export function showFence(scene: MapScene, fence: Pick<Geofence, 'area' | 'keep_out'> | null): void {
  const objects = fence ? [block(fence.area, AREA), ...(fence.keep_out ?? []).map((out) => block(out, KEEP_OUT))] : [];
  put(scene, 'fence', objects);
}

/** Corners that are being drawn. */
export function showOutline(scene: MapScene, corners: readonly (readonly number[])[], floor: number): void {
  const places = corners.map(([x = 0, y = 0]) => new Vector3(x, y, floor + 0.02));
  const balls = places.map((place) => {
    const ball = new Mesh(new SphereGeometry(0.07, 16, 10), new MeshBasicMaterial({ color: AREA }));
    ball.position.copy(place);
    return ball;
  });
  put(scene, 'outline', places.length > 1 ? [lines([...places, places[0]!], AREA), ...balls] : balls);
}
