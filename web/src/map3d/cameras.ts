// The cameras of a map: a pyramid each, to be clicked on.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  InstancedMesh,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  type Texture,
  Vector3,
} from 'three';
import type { Camera, CameraPose } from '../api/types';
import { quaternion, threeOrientation, vector } from './frames';
import type { View } from './scene';

/** Half extents of the picture at distance one, and where the lens looks in it. */
export interface Opening {
  left: number;
  right: number;
  top: number;
  bottom: number;
}

/** By the pinhole part of the model; distortion bends the edges of the picture a little. */
export function openingOf(camera: Camera): Opening {
  const single = camera.model.startsWith('SIMPLE') || camera.model === 'RADIAL';
  const [fx = 1, fy = fx, cx = camera.width / 2, cy = camera.height / 2] = single
    ? [camera.params[0], camera.params[0], camera.params[1], camera.params[2]]
    : camera.params;
  return {
    left: -cx / fx,
    right: (camera.width - cx) / fx,
    top: -cy / fy,
    bottom: (camera.height - cy) / fy,
  };
}

/** A view of the scene that holds the whole picture of a camera. */
export function viewThrough(pose: CameraPose, camera: Camera, aspect: number): View {
  const { left, right, top, bottom } = openingOf(camera);
  const high = Math.max(-top, bottom);
  const wide = Math.max(-left, right);
  const half = Math.max(high, wide / aspect) * 1.04;
  return {
    position: vector(pose.position),
    orientation: threeOrientation(pose),
    fov: (2 * Math.atan(half) * 180) / Math.PI,
  };
}

function corners({ left, right, top, bottom }: Opening, depth: number): Vector3[] {
  return [[left, top], [right, top], [right, bottom], [left, bottom]].map(
    ([x, y]) => new Vector3(x, y, 1).multiplyScalar(depth));
}

/** Edges of pyramids, with a little roof over the upper edge of the picture. */
const EDGES = [0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1, 1, 5, 5, 2];
const FACES = [0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 1];

function pyramid(opening: Opening, depth: number): Vector3[] {
  const [a, b, c, d] = corners(opening, depth) as [Vector3, Vector3, Vector3, Vector3];
  const roof = a.clone().lerp(b, 0.5).add(new Vector3(0, (opening.top - opening.bottom) * 0.22 * depth, 0));
  return [new Vector3(), a, b, c, d, roof];
}

/** The pyramid of one camera, as lines. */
export function frustum(pose: CameraPose, camera: Camera, depth: number, color: Color): LineSegments {
  const points = pyramid(openingOf(camera), depth);
  const geometry = new BufferGeometry().setFromPoints(EDGES.map((index) => points[index]!));
  const lines = new LineSegments(geometry, new LineBasicMaterial({ color }));
  lines.position.copy(vector(pose.position));
  lines.quaternion.copy(quaternion(pose.orientation));
  return lines;
}

/** All cameras of a map in two draw calls. */
export class Frusta {
  readonly lines: LineSegments;
  /** Hit by clicks; `instanceId` is the index of the camera. */
  readonly faces: InstancedMesh;
  private readonly colors: Float32Array;

  constructor(poses: CameraPose[], camera: Camera, depth: number, private readonly color: Color) {
    const points = pyramid(openingOf(camera), depth);
    const positions = new Float32Array(poses.length * EDGES.length * 3);
    this.colors = new Float32Array(positions.length);
    const geometry = new BufferGeometry().setFromPoints(points.slice(0, 5)).setIndex(FACES);
    const material = new MeshBasicMaterial({
      color, transparent: true, opacity: 0.12, side: DoubleSide, depthWrite: false,
    });
    this.faces = new InstancedMesh(geometry, material, poses.length);
    const one = new Vector3(1, 1, 1);
    poses.forEach((pose, index) => {
      const matrix = new Matrix4().compose(vector(pose.position), quaternion(pose.orientation), one);
      this.faces.setMatrixAt(index, matrix);
      EDGES.forEach((corner, edge) => {
        points[corner]!.clone().applyMatrix4(matrix).toArray(positions, (index * EDGES.length + edge) * 3);
      });
    });
    const edges = new BufferGeometry();
    edges.setAttribute('position', new BufferAttribute(positions, 3));
    edges.setAttribute('color', new BufferAttribute(this.colors, 3));
    this.lines = new LineSegments(edges, new LineBasicMaterial({ vertexColors: true }));
    this.lines.raycast = () => {};
    this.mark(null, color);
  }

  /** Paints one camera in `color`, the others in their own. */
  mark(index: number | null, color: Color): void {
    const per = EDGES.length;
    for (let i = 0; i * 3 < this.colors.length; i++) {
      (Math.floor(i / per) === index ? color : this.color).toArray(this.colors, i * 3);
    }
    this.lines.geometry.getAttribute('color').needsUpdate = true;
  }
}

/** A photo where its camera saw it, drawn over everything. */
export function photoPlane(pose: CameraPose, camera: Camera, texture: Texture, depth: number): Mesh {
  const points = corners(openingOf(camera), depth);
  const geometry = new BufferGeometry().setFromPoints(points).setIndex([0, 2, 1, 0, 3, 2]);
  const uv = new Float32Array([0, 1, 1, 1, 1, 0, 0, 0]);
  geometry.setAttribute('uv', new BufferAttribute(uv, 2));
  const material = new MeshBasicMaterial({
    map: texture, transparent: true, opacity: 0, depthTest: false, depthWrite: false, side: DoubleSide,
    toneMapped: false,
  });
  const mesh = new Mesh(geometry, material);
  mesh.renderOrder = 10;
  mesh.raycast = () => {};
  mesh.position.copy(vector(pose.position));
  mesh.quaternion.copy(quaternion(pose.orientation));
  return mesh;
}
