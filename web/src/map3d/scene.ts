// A scene in the frame of the map, drawn only when something has changed.
import {
  Box3,
  Color,
  Group,
  HemisphereLight,
  type Object3D,
  PerspectiveCamera,
  Quaternion,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
  type Intersection,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { effect } from '@preact/signals';
import { cssColor, theme } from '../state/theme';
import { axes, grid } from './furniture';
import { useMapFrame } from './frames';
import { Pace } from './pace';

useMapFrame();

const FIELD_OF_VIEW_DEG = 55;
/** A press that moves further than this, pixels, turns the view and is no click. */
const CLICK_PX = 5;

export interface Click {
  /** Nearest first. */
  hits: Intersection[];
  event: PointerEvent;
}

/** Answers whether it took the click; the newest listener is asked first. */
export type ClickListener = (click: Click) => boolean;

export interface View {
  position: Vector3;
  orientation: Quaternion;
  /** Vertical, degrees. */
  fov: number;
}

export class MapScene {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.02, 500);
  readonly renderer: WebGLRenderer;
  readonly controls: OrbitControls;
  private readonly layers = new Map<string, Group>();
  private readonly animations = new Set<(seconds: number) => boolean>();
  private readonly clicks: ClickListener[] = [];
  private readonly drawn = new Set<() => void>();
  private readonly endings: (() => void)[] = [];
  private readonly pace: Pace;
  private frame = 0;
  private lastTime = 0;
  /** Whether the view is being turned by hand. */
  private held = false;
  private pressed: { x: number; y: number } | null = null;

  constructor(readonly host: HTMLElement) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: 'low-power' });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.pace = new Pace(this.renderer.getContext() as WebGL2RenderingContext);
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', 'Map in 3-D. Arrow keys move the view, plus and minus zoom.');
    host.prepend(canvas);

    this.scene.add(new HemisphereLight(0xffffff, 0x8a8f98, 3));
    this.camera.position.set(-6, -4, 5);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.zoomToCursor = true;
    this.controls.minDistance = 0.05;
    this.controls.maxDistance = 300;
    this.controls.listenToKeyEvents(canvas);
    this.controls.keyPanSpeed = 20;
    this.controls.addEventListener('change', this.invalidate);
    this.controls.addEventListener('start', () => (this.held = true));
    this.controls.addEventListener('end', () => (this.held = false));

    const size = new ResizeObserver(() => this.resize());
    size.observe(host);
    this.endings.push(() => size.disconnect());
    this.listen(canvas);
    this.endings.push(effect(() => this.paintTheme(theme.value)));
    this.resize();
  }

  /** A group by name; it is made when it is first asked for. */
  layer(name: string): Group {
    let layer = this.layers.get(name);
    if (!layer) {
      layer = new Group();
      layer.name = name;
      this.layers.set(name, layer);
      this.scene.add(layer);
    }
    return layer;
  }

  show(name: string, visible: boolean): void {
    this.layer(name).visible = visible;
    this.invalidate();
  }

  /** Takes everything out of a layer and frees it. */
  clear(name: string): void {
    const layer = this.layer(name);
    for (const child of [...layer.children]) dispose(child);
    layer.clear();
    this.invalidate();
  }

  /** Draws once, soon. */
  readonly invalidate = (): void => {
    if (this.frame === 0) this.frame = requestAnimationFrame(this.draw);
  };

  /** Calls `step` before each picture, with the seconds since the last one, while it answers true. */
  animate(step: (seconds: number) => boolean): () => void {
    this.animations.add(step);
    this.invalidate();
    return () => this.animations.delete(step);
  }

  /** Called after each picture: for labels that follow things. */
  onDrawn(listener: () => void): () => void {
    this.drawn.add(listener);
    return () => this.drawn.delete(listener);
  }

  /** A click that moved nothing; see `ClickListener`. */
  onClick(listener: ClickListener): () => void {
    this.clicks.unshift(listener);
    return () => {
      const index = this.clicks.indexOf(listener);
      if (index >= 0) this.clicks.splice(index, 1);
    };
  }

  /** What lies under a point of the screen, nearest first; only what is visible. */
  pick(event: { clientX: number; clientY: number }, among: Object3D[]): Intersection[] {
    const box = this.renderer.domElement.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * 2 - 1;
    const y = 1 - ((event.clientY - box.top) / box.height) * 2;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2(x, y), this.camera);
    // Points are hit within a few pixels at the distance of the target.
    const distance = this.camera.position.distanceTo(this.controls.target);
    const meters_per_px = (2 * distance * Math.tan((this.camera.fov * Math.PI) / 360)) / box.height;
    ray.params.Points.threshold = 4 * meters_per_px;
    ray.params.Line.threshold = 4 * meters_per_px;
    return ray.intersectObjects(among, true).filter((hit) => isVisible(hit.object));
  }

  /** Where a place of the map is on the screen, pixels from the corner of the host; `null` behind. */
  toScreen(place: Vector3): { x: number; y: number } | null {
    const p = place.clone().project(this.camera);
    if (p.z > 1) return null;
    const { clientWidth, clientHeight } = this.host;
    return { x: ((p.x + 1) / 2) * clientWidth, y: ((1 - p.y) / 2) * clientHeight };
  }

  /** Looks at a box from above and behind, as the forward axis goes. */
  fit(box: Box3): void {
    if (box.isEmpty()) return;
    const center = box.getCenter(new Vector3());
    const radius = Math.max(box.getSize(new Vector3()).length() / 2, 0.5);
    const narrow = Math.min(this.camera.aspect, 1);
    const distance = radius / Math.sin((FIELD_OF_VIEW_DEG * Math.PI) / 360) / narrow;
    this.setFov(FIELD_OF_VIEW_DEG);
    this.controls.target.copy(center);
    this.camera.up.set(0, 0, 1);
    this.camera.position.copy(center).add(new Vector3(-0.75, -0.45, 0.6).setLength(distance));
    this.controls.update();
    this.invalidate();
  }

  view(): View {
    return {
      position: this.camera.position.clone(),
      orientation: this.camera.quaternion.clone(),
      fov: this.camera.fov,
    };
  }

  /** Moves to a view; the orbit then turns about a place `ahead` meters before it. */
  async flyTo(to: View, seconds: number, ahead = 2): Promise<void> {
    const from = this.view();
    this.controls.enabled = false;
    await new Promise<void>((done) => {
      let time = 0;
      this.animate((step) => {
        time += step;
        const part = seconds > 0 ? Math.min(time / seconds, 1) : 1;
        const smooth = part * part * (3 - 2 * part);
        this.camera.position.lerpVectors(from.position, to.position, smooth);
        this.camera.quaternion.slerpQuaternions(from.orientation, to.orientation, smooth);
        this.setFov(from.fov + (to.fov - from.fov) * smooth);
        if (part < 1) return true;
        done();
        return false;
      });
    });
    const forward = new Vector3(0, 0, -1).applyQuaternion(to.orientation);
    this.controls.target.copy(to.position).addScaledVector(forward, ahead);
    this.controls.enabled = true;
  }

  setFov(degrees: number): void {
    this.camera.fov = degrees;
    this.camera.updateProjectionMatrix();
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    this.frame = -1;
    for (const end of this.endings) end();
    this.controls.dispose();
    dispose(this.scene);
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  private readonly draw = (time: number): void => {
    this.frame = 0;
    // What is watched may lag a little; what is moved may not.
    const isMoved = this.held || this.animations.size > 0;
    if (!this.pace.ready(time) && !isMoved) {
      this.invalidate();
      return;
    }
    const seconds = this.lastTime > 0 ? Math.min((time - this.lastTime) / 1000, 0.1) : 0;
    this.lastTime = this.animations.size > 0 ? time : 0;
    for (const step of [...this.animations]) {
      if (!step(seconds)) this.animations.delete(step);
    }
    this.paint(time);
    if (this.animations.size > 0) this.invalidate();
  };

  private paint(time: number): void {
    this.renderer.render(this.scene, this.camera);
    this.pace.drawn(time);
    for (const call of this.drawn) call();
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.host;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    // A new size wipes the picture: it is drawn before anybody sees that.
    this.paint(performance.now());
  }

  private listen(canvas: HTMLCanvasElement): void {
    canvas.addEventListener('pointerdown', (event) => {
      this.pressed = event.button === 0 ? { x: event.clientX, y: event.clientY } : null;
    });
    canvas.addEventListener('pointerup', (event) => {
      const from = this.pressed;
      this.pressed = null;
      if (!from || Math.hypot(event.clientX - from.x, event.clientY - from.y) > CLICK_PX) return;
      const hits = this.pick(event, [...this.layers.values()]);
      for (const listener of [...this.clicks]) if (listener({ hits, event })) return;
    });
    canvas.addEventListener('keydown', (event) => {
      const factor = event.key === '+' || event.key === '=' ? 0.85 : event.key === '-' ? 1 / 0.85 : 0;
      if (factor === 0) return;
      event.preventDefault();
      this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
      this.controls.update();
    });
  }

  private paintTheme(_theme: string): void {
    // The style sheet follows the theme a moment later.
    queueMicrotask(() => {
      this.scene.background = new Color(cssColor('--scene'));
      this.clear('grid');
      this.layer('grid').add(grid(cssColor('--scene-grid'), cssColor('--scene-grid-strong')));
      if (this.layer('axes').children.length === 0) this.layer('axes').add(axes());
      this.invalidate();
    });
  }
}

function isVisible(object: Object3D): boolean {
  for (let at: Object3D | null = object; at; at = at.parent) if (!at.visible) return false;
  return true;
}

/** Frees what an object holds on the graphics card. */
export function dispose(object: Object3D): void {
  object.traverse((part) => {
    const { geometry, material } = part as Partial<import('three').Mesh>;
    geometry?.dispose();
    for (const one of material ? [material].flat() : []) {
      for (const value of Object.values(one)) {
        if (value && typeof value === 'object' && 'isTexture' in value) (value as import('three').Texture).dispose();
      }
      one.dispose();
    }
  });
}
