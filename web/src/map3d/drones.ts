// Drones in the scene. Shapes are shared and moved; a trail is a ring of fixed length: memory does
// not grow while they fly.
import {
  BufferAttribute,
  BufferGeometry,
  ConeGeometry,
  Group,
  Line,
  LineBasicMaterial,
  LineDashedMaterial,
  LineLoop,
  LineSegments,
  type Material,
  Mesh,
  MeshBasicMaterial,
  Quaternion,
  SphereGeometry,
  TorusGeometry,
  Vector3,
} from 'three';
import type { Schema } from '../api/types';
import { UP, ellipsoid, quaternion, vector } from './frames';
import type { MapScene } from './scene';

/** What is to be drawn of a drone. */
export interface DroneView {
  id: number;
  label: string;
  position: readonly number[];
  yaw: number;
  /** `map_from_camera` of its camera, where that is known now. */
  camera: readonly number[] | null;
  mount: Schema<'CameraMount'>;
  /** 3 x 3, meters squared. */
  covariance: readonly (readonly number[])[] | null;
  target: readonly number[] | null;
  /** Poses are fresh; old; or it is not heard any more. */
  trust: 'fresh' | 'stale' | 'lost';
}

const TRAIL = 600;
/** A trail gets a point each this often, so that it shows a minute and more. */
const TRAIL_EVERY_M = 0.03;
const SIGMAS = 2;
const ROTOR_M = 0.09;
const ARM_M = 0.13;

/** Colors that differ by lightness, too; each drone keeps its own. */
const COLORS = [0x1f77c8, 0xd9730d, 0x7a3fb5, 0x0b8a6f, 0xc2317a, 0x8a6d00, 0x3f51b5, 0x5d7a1f];
const STALE = 0xc98a00;
const LOST = 0x808890;

export const colorOf = (id: number): string =>
  `#${COLORS[(id - 1 + COLORS.length * 32) % COLORS.length]!.toString(16).padStart(6, '0')}`;

class Shapes {
  readonly rotor = new TorusGeometry(ROTOR_M, 0.016, 6, 20);
  readonly nose = new ConeGeometry(0.055, 0.2, 12).rotateZ(-Math.PI / 2);
  readonly ball = new SphereGeometry(1, 20, 14);
  readonly ring = new BufferGeometry().setFromPoints(circle(0.16));
  readonly cross = new BufferGeometry().setFromPoints(
    [[-1, -1], [1, 1], [-1, 1], [1, -1]].map(([x = 0, y = 0]) => new Vector3(x * 0.3, y * 0.3, 0)));

  dispose(): void {
    for (const shape of Object.values(this) as BufferGeometry[]) shape.dispose();
  }
}

class Mark {
  readonly group = new Group();
  readonly label = document.createElement('div');
  private readonly body = new Group();
  private readonly solid: MeshBasicMaterial;
  private readonly thin: LineBasicMaterial;
  private readonly haze: MeshBasicMaterial;
  private readonly blob: Mesh;
  private readonly shadow: LineLoop;
  private readonly drop: Line;
  private readonly cross: LineSegments;
  private readonly goal: Mesh;
  private readonly way: Line;
  private readonly trail: Line;
  private readonly points = new Float32Array(TRAIL * 3);
  private length = 0;
  private text = '';

  constructor(readonly id: number, shapes: Shapes) {
    const color = colorOf(id);
    this.solid = new MeshBasicMaterial({ color });
    this.thin = new LineBasicMaterial({ color, transparent: true, opacity: 0.75 });
    this.haze = new MeshBasicMaterial({ color, transparent: true, opacity: 0.22, depthWrite: false });
    for (const [x, y] of [[1, 1], [1, -1], [-1, 1], [-1, -1]] as const) {
      const rotor = new Mesh(shapes.rotor, this.solid);
      rotor.position.set(x * ARM_M, y * ARM_M, 0);
      this.body.add(rotor);
    }
    const nose = new Mesh(shapes.nose, this.solid);
    nose.position.x = 0.12;
    this.cross = new LineSegments(shapes.cross, this.thin);
    this.body.add(nose, this.cross);
    this.blob = new Mesh(shapes.ball, this.haze);
    this.blob.matrixAutoUpdate = false;
    this.shadow = new LineLoop(shapes.ring, this.thin);
    this.drop = new Line(segment(), this.thin);
    this.goal = new Mesh(shapes.ball, new MeshBasicMaterial({ color, wireframe: true, transparent: true, opacity: 0.6 }));
    this.goal.scale.setScalar(0.1);
    this.way = new Line(segment(), new LineDashedMaterial({ color, dashSize: 0.12, gapSize: 0.08 }));
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(this.points, 3));
    geometry.setDrawRange(0, 0);
    this.trail = new Line(geometry, this.thin);
    for (const line of [this.drop, this.way, this.trail]) line.frustumCulled = false;
    this.group.add(this.body, this.blob, this.shadow, this.drop, this.goal, this.way, this.trail);
    // Clicks on drones are for the ground beneath them; labels take their own.
    this.group.traverse((part) => (part.raycast = () => {}));
    this.label.className = 'drone-label';
    this.label.setAttribute('aria-hidden', 'true');
  }

  update(view: DroneView, floor: number): void {
    const at = vector(view.position);
    this.body.position.copy(at);
    this.body.quaternion.copy(attitude(view));
    this.cross.visible = view.trust === 'lost';
    const color = { fresh: colorOf(view.id), stale: STALE, lost: LOST }[view.trust];
    this.solid.color.set(color);
    this.solid.wireframe = view.trust !== 'fresh';
    this.haze.color.set(color);

    this.blob.visible = view.covariance !== null && view.trust === 'fresh';
    if (view.covariance) this.blob.matrix.copy(ellipsoid(view.covariance, SIGMAS)).setPosition(at);

    this.shadow.position.set(at.x, at.y, floor + 0.01);
    setSegment(this.drop, at, this.shadow.position);
    this.goal.visible = this.way.visible = view.target !== null;
    if (view.target) {
      this.goal.position.copy(vector(view.target));
      setSegment(this.way, at, this.goal.position);
      this.way.computeLineDistances();
    }
    if (view.trust === 'fresh') this.remember(at);
    const text = view.trust === 'fresh' ? view.label : `${view.label} · ${view.trust}`;
    if (text !== this.text) this.label.textContent = this.text = text;
    this.label.dataset.trust = view.trust;
  }

  place(scene: MapScene): void {
    const at = scene.toScreen(this.body.position);
    this.label.style.display = at ? '' : 'none';
    if (at) this.label.style.transform = `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px) translate(-50%, -220%)`;
  }

  private remember(at: Vector3): void {
    const { points } = this;
    const end = this.length * 3;
    if (this.length > 0) {
      const moved = Math.hypot(at.x - points[end - 3]!, at.y - points[end - 2]!, at.z - points[end - 1]!);
      if (moved < TRAIL_EVERY_M) return;
    }
    if (this.length === TRAIL) points.copyWithin(0, 3);
    else this.length += 1;
    at.toArray(points, (this.length - 1) * 3);
    this.trail.geometry.setDrawRange(0, this.length);
    this.trail.geometry.attributes.position!.needsUpdate = true;
  }

  dispose(): void {
    this.label.remove();
    for (const line of [this.drop, this.way, this.trail]) line.geometry.dispose();
    const materials = [this.solid, this.thin, this.haze, this.goal.material, this.way.material];
    for (const material of materials) (material as Material).dispose();
  }
}

/** All drones of a scene. */
export class DroneMarks {
  private readonly shapes = new Shapes();
  private readonly marks = new Map<number, Mark>();
  private readonly end: () => void;

  /** `overlay` lies over the scene and takes the labels; `floor`: height of the lines' feet. */
  constructor(private readonly scene: MapScene, private readonly overlay: HTMLElement, public floor: number) {
    this.end = scene.onDrawn(() => {
      for (const mark of this.marks.values()) mark.place(scene);
    });
  }

  update(views: readonly DroneView[]): void {
    for (const view of views) {
      let mark = this.marks.get(view.id);
      if (!mark) {
        mark = new Mark(view.id, this.shapes);
        this.marks.set(view.id, mark);
        this.scene.layer('drones').add(mark.group);
        this.overlay.append(mark.label);
      }
      mark.update(view, this.floor);
    }
    for (const [id, mark] of this.marks) {
      if (views.some((view) => view.id === id)) continue;
      this.scene.layer('drones').remove(mark.group);
      mark.dispose();
      this.marks.delete(id);
    }
    this.scene.invalidate();
  }

  dispose(): void {
    this.update([]);
    this.shapes.dispose();
    this.end();
  }
}

/** Full attitude by the camera where that is known, else level by the heading. */
function attitude(view: DroneView): Quaternion {
  if (!view.camera) return new Quaternion().setFromAxisAngle(UP, view.yaw);
  return quaternion(view.camera).multiply(quaternion(view.mount.orientation).invert());
}

function circle(radius: number): Vector3[] {
  return Array.from({ length: 32 }, (_, k) => {
    const angle = (k * Math.PI) / 16;
    return new Vector3(radius * Math.cos(angle), radius * Math.sin(angle), 0);
  });
}

function segment(): BufferGeometry {
  return new BufferGeometry().setAttribute('position', new BufferAttribute(new Float32Array(6), 3));
}

function setSegment(line: Line, from: Vector3, to: Vector3): void {
  const positions = line.geometry.getAttribute('position') as BufferAttribute;
  from.toArray(positions.array, 0);
  to.toArray(positions.array, 3);
  positions.needsUpdate = true;
}
