// The one place where frames of docs/frames-and-units.md meet those of three.js.
//
// The world of the scene is the frame `map` itself (z up, meters): positions go in as they are.
// What differs is the camera (three.js looks along -z with y up) and glTF (y up).
import { Matrix4, Object3D, Quaternion, Vector3 } from 'three';
import type { CameraPose } from '../api/types';

export const UP = new Vector3(0, 0, 1);

/** Objects that are made from now on have z up. */
export function useMapFrame(): void {
  Object3D.DEFAULT_UP.copy(UP);
}

/** glTF (y up, z forward, x left) to the map (z up, x forward, y left). */
export const MAP_FROM_GLTF = new Quaternion(0.5, 0.5, 0.5, 0.5);

/** A camera of three.js (y up, looks along -z) in the axes of ours (y down, looks along z). */
const CAMERA_FROM_THREE = new Quaternion(1, 0, 0, 0);

/** Quaternions of the API are w, x, y, z. */
export function quaternion(wxyz: readonly number[]): Quaternion {
  const [w = 1, x = 0, y = 0, z = 0] = wxyz;
  return new Quaternion(x, y, z, w);
}

export function vector(xyz: readonly number[]): Vector3 {
  const [x = 0, y = 0, z = 0] = xyz;
  return new Vector3(x, y, z);
}

export const wxyz = (q: Quaternion): [number, number, number, number] => [q.w, q.x, q.y, q.z];
export const xyz = (v: Vector3): [number, number, number] => [v.x, v.y, v.z];

/** `map_from_camera` for an object whose children are in camera axes (x right, y down, z forward). */
export function placeCamera(object: Object3D, pose: CameraPose): void {
  object.position.copy(vector(pose.position));
  object.quaternion.copy(quaternion(pose.orientation));
}

/** Orientation that a camera of three.js needs to look as the pose does. */
export function threeOrientation(pose: CameraPose): Quaternion {
  return quaternion(pose.orientation).multiply(CAMERA_FROM_THREE);
}

/** The pose that a camera of three.js has. */
export function poseOf(camera: Object3D): CameraPose {
  const orientation = camera.quaternion.clone().multiply(CAMERA_FROM_THREE.clone().invert());
  return { position: xyz(camera.position), orientation: wxyz(orientation) };
}

/** Heading in the map: radians counter-clockwise from x, seen from above. */
export function yawOf(forward: Vector3): number {
  return Math.atan2(forward.y, forward.x);
}

/** Ellipsoid of a 3 x 3 covariance: turns and stretches a unit sphere to `sigmas` deviations. */
export function ellipsoid(covariance: readonly (readonly number[])[], sigmas: number): Matrix4 {
  const at = (i: number, j: number) => covariance[i]?.[j] ?? 0;
  // Cholesky: with cov = L Lᵀ, L maps the unit sphere to the surface of one deviation.
  const l: number[][] = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j <= i; j++) {
      let sum = at(i, j);
      for (let k = 0; k < j; k++) sum -= l[i]![k]! * l[j]![k]!;
      l[i]![j] = i === j ? Math.sqrt(Math.max(sum, 1e-12)) : sum / l[j]![j]!;
    }
  }
  const m = (i: number, j: number) => sigmas * l[i]![j]!;
  return new Matrix4().set(
    m(0, 0), 0, 0, 0,
    m(1, 0), m(1, 1), 0, 0,
    m(2, 0), m(2, 1), m(2, 2), 0,
    0, 0, 0, 1);
}
