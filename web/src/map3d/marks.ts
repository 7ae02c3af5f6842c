// What tools draw into the scene: measured distances, a new origin, the place of a photo.
import {
  ArrowHelper,
  BufferGeometry,
  Color,
  Group,
  LineBasicMaterial,
  LineSegments,
  Line,
  Mesh,
  MeshBasicMaterial,
  SphereGeometry,
  Vector3,
} from 'three';
import type { Camera, CameraPose } from '../api/types';
import { cssColor } from '../state/theme';
import { frustum } from './cameras';
import { ellipsoid, vector } from './frames';

/** Drawn over everything, so that no wall hides it. */
const OVER = { depthTest: false, transparent: true } as const;

function over<T extends Mesh | Line>(object: T): T {
  object.renderOrder = 20;
  object.raycast = () => {};
  return object;
}

export function dot(place: Vector3, radius: number, color: string): Mesh {
  const mesh = new Mesh(new SphereGeometry(radius, 20, 14), new MeshBasicMaterial({ color, ...OVER }));
  mesh.position.copy(place);
  return over(mesh);
}

export function line(from: Vector3, to: Vector3, color: string): Line {
  return over(new Line(
    new BufferGeometry().setFromPoints([from, to]), new LineBasicMaterial({ color, ...OVER })));
}

/** Where the axes of the map would be: x forward, y left. */
export function frameMark(origin: Vector3, yaw: number, length: number): Group {
  const group = new Group();
  const arrow = (angle: number, part: number, color: number) => {
    const direction = new Vector3(Math.cos(angle), Math.sin(angle), 0);
    const helper = new ArrowHelper(direction, origin, length * part, color, 0.15 * length, 0.08 * length);
    over(helper.line as Line);
    over(helper.cone as Mesh);
    for (const part of [helper.line, helper.cone]) Object.assign(part.material, OVER);
    return helper;
  };
  group.add(arrow(yaw, 1, 0xd43d2a), arrow(yaw + Math.PI / 2, 0.6, 0x2f9e44));
  group.add(dot(origin, 0.04 * length, cssColor('--accent')));
  return group;
}

/**
 * Where a photo was taken: its camera, and the ellipsoid that holds the true place with 97 %
 * (three standard deviations). `covariance`: 6 x 6, row by row, position first.
 */
export function locatedPhoto(
  pose: CameraPose,
  camera: Camera,
  covariance: readonly number[] | null | undefined,
  depth: number,
): Group {
  const group = new Group();
  const color = cssColor('--good');
  const lines = frustum(pose, camera, depth, new Color(color));
  Object.assign(lines.material, OVER);
  group.add(over(lines as LineSegments));
  if (covariance?.length === 36) {
    const rows = [0, 1, 2].map((row) => covariance.slice(row * 6, row * 6 + 3));
    const mesh = new Mesh(
      new SphereGeometry(1, 24, 16),
      new MeshBasicMaterial({ color, ...OVER, opacity: 0.35 }));
    mesh.matrixAutoUpdate = false;
    mesh.matrix.copy(ellipsoid(rows, 3)).setPosition(vector(pose.position));
    group.add(over(mesh));
  }
  return group;
}
