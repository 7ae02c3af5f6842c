// What every map has: a grid, and the axes at its origin.
import {
  ArrowHelper,
  Group,
  GridHelper,
  Mesh,
  MeshBasicMaterial,
  SphereGeometry,
  Vector3,
} from 'three';

const GRID_M = 40;

/** Lines one meter apart; not for clicks. */
export function grid(color: string, strong: string): GridHelper {
  const helper = new GridHelper(GRID_M, GRID_M, strong, color);
  helper.rotateX(Math.PI / 2);
  helper.raycast = () => {};
  return helper;
}

/** Origin with x (forward, red and longer), y (left, green) and z (up, blue). */
export function axes(): Group {
  const group = new Group();
  const origin = new Vector3();
  const arrow = (x: number, y: number, z: number, length: number, color: number) =>
    new ArrowHelper(new Vector3(x, y, z), origin, length, color, 0.14, 0.07);
  group.add(
    arrow(1, 0, 0, 1, 0xd43d2a),
    arrow(0, 1, 0, 0.6, 0x2f9e44),
    arrow(0, 0, 1, 0.6, 0x2f6fd6),
    new Mesh(new SphereGeometry(0.04, 16, 12), new MeshBasicMaterial({ color: 0x8a949e })),
  );
  group.traverse((part) => (part.raycast = () => {}));
  return group;
}
