// The scene of one map: what is shown, what is chosen, what is being measured. Panels read its
// signals and call its methods; only it touches the scene.
import { effect, signal } from '@preact/signals';
import { Color, type Intersection, Vector3 } from 'three';
import { photoBytes } from '../../api/photos';
import type { Camera, Image, LocalizeAnswer } from '../../api/types';
import { Frusta } from '../../map3d/cameras';
import { vector, yawOf } from '../../map3d/frames';
import { boundsOf, firstLayer, layersOf, showLayer, type MapLayer } from '../../map3d/map-layers';
import { dot, frameMark, line, locatedPhoto } from '../../map3d/marks';
import type { MapScene } from '../../map3d/scene';
import { Tour } from '../../map3d/tour';
import { cssColor, theme } from '../../state/theme';
import { toastError } from '../../state/toasts';
import type { MapData } from './map-data';

export type Tool = 'look' | 'ruler' | 'frame';

export class MapViewer {
  readonly layers: MapLayer[];
  readonly shown = signal<ReadonlySet<string>>(new Set(['cameras', 'grid', 'axes']));
  readonly loading = signal<MapLayer | null>(null);
  /** Index of the chosen camera. */
  readonly chosen = signal<number | null>(null);
  readonly tool = signal<Tool>('look');
  /** Clicked with a tool: two places at most. */
  readonly marks = signal<Vector3[]>([]);
  readonly photos = signal<ReadonlyMap<string, Image> | null>(null);
  readonly tour: Tour;
  /** Size of what is drawn, by the size of the map. */
  private readonly unit: number;
  private frusta: Frusta | null = null;
  private readonly endings: (() => void)[] = [];
  private readonly abort = new AbortController();

  constructor(readonly scene: MapScene, readonly data: MapData) {
    this.layers = layersOf(data.version);
    const bounds = boundsOf(data.version);
    const size = bounds.isEmpty() ? 4 : bounds.getSize(new Vector3()).length();
    this.unit = Math.max(size / 45, 0.02);
    this.tour = new Tour(scene, data.placed, this.unit * 1.4);
    this.home();
    // The floor of the map, as far as it is known.
    if (!bounds.isEmpty()) scene.layer('grid').position.z = bounds.min.z;
    const first = firstLayer(data.version);
    if (first) void this.toggle(first);
    this.endings.push(
      effect(() => this.drawFrusta(theme.value)),
      effect(() => this.drawMarks(this.marks.value, this.tool.value)),
      effect(() => this.paintChosen(this.chosen.value)),
      // On the way cameras would stand in the view.
      effect(() => scene.show('cameras', this.shown.value.has('cameras') && !this.tour.playing.value)),
      scene.onClick(({ hits }) => this.click(hits)),
    );
  }

  dispose(): void {
    this.abort.abort();
    for (const end of this.endings) end();
  }

  async toggle(layer: MapLayer | 'cameras' | 'grid' | 'axes'): Promise<void> {
    const shown = new Set(this.shown.value);
    if (shown.delete(layer)) {
      this.scene.show(layer, false);
      this.shown.value = shown;
      return;
    }
    this.shown.value = shown.add(layer);
    if (layer === 'cameras') return;
    if (layer === 'grid' || layer === 'axes') {
      this.scene.show(layer, true);
      return;
    }
    this.loading.value = layer;
    try {
      await showLayer(this.scene, this.data.version, layer, this.abort.signal);
      performance.mark(`map-${layer}`);
    } catch (error) {
      if (!this.abort.signal.aborted) toastError(error);
    } finally {
      this.loading.value = null;
    }
  }

  home(): void {
    this.choose(null);
    const all = boundsOf(this.data.version);
    for (const { pose } of this.data.placed) all.expandByPoint(vector(pose.position));
    this.scene.fit(all);
  }

  use(tool: Tool): void {
    this.marks.value = [];
    this.tool.value = this.tool.value === tool ? 'look' : tool;
  }

  choose(index: number | null): void {
    this.tour.leave();
    this.tour.pause();
    this.chosen.value = index;
  }

  async photoOf(index: number): Promise<Blob | null> {
    const placed = this.data.placed[index];
    const image = placed && this.photos.value?.get(placed.name);
    return image ? photoBytes(image) : null;
  }

  async lookThrough(index: number): Promise<void> {
    const placed = this.data.placed[index];
    if (!placed) return;
    this.chosen.value = index;
    this.tour.at.value = index;
    try {
      await this.tour.lookThrough(placed, await this.photoOf(index));
    } catch (error) {
      toastError(error);
    }
  }

  /** Shows where a photo was found to have been taken, and looks there. */
  showLocated(answer: LocalizeAnswer | null, camera: Camera | undefined): void {
    this.scene.clear('located');
    if (!answer?.pose || !camera) return;
    const mark = locatedPhoto(answer.pose, camera, answer.covariance, this.unit * 1.6);
    this.scene.layer('located').add(mark);
    this.scene.invalidate();
  }

  private click(hits: Intersection[]): boolean {
    if (this.tool.value === 'look') {
      const hit = hits.find(({ object }) => object === this.frusta?.faces);
      if (hit?.instanceId === undefined) return false;
      this.choose(hit.instanceId);
      return true;
    }
    const surface = hits.find(({ object }) => this.isSurface(object));
    if (!surface) return false;
    const marks = this.marks.value;
    this.marks.value = marks.length < 2 ? [...marks, surface.point.clone()] : [surface.point.clone()];
    return true;
  }

  private isSurface(object: Intersection['object']): boolean {
    for (let at: typeof object | null = object; at; at = at.parent) {
      if (this.layers.some((name) => name === at?.name)) return true;
    }
    return false;
  }

  private drawFrusta(_theme: string): void {
    const { placed } = this.data;
    this.scene.clear('cameras');
    const camera = placed[0]?.camera;
    if (!camera) return;
    const color = new Color(cssColor('--accent'));
    this.frusta = new Frusta(placed.map(({ pose }) => pose), camera, this.unit, color);
    this.scene.layer('cameras').add(this.frusta.lines, this.frusta.faces);
    this.paintChosen(this.chosen.peek());
  }

  private paintChosen(index: number | null): void {
    this.frusta?.mark(index, new Color(cssColor('--chosen')));
    this.scene.invalidate();
  }

  private drawMarks(marks: Vector3[], tool: Tool): void {
    this.scene.clear('marks');
    this.scene.renderer.domElement.style.cursor = tool === 'look' ? '' : 'crosshair';
    const layer = this.scene.layer('marks');
    const [from, to] = marks;
    const color = cssColor('--chosen');
    if (tool === 'frame' && from) {
      const forward = to ? to.clone().sub(from) : new Vector3(1, 0, 0);
      layer.add(frameMark(from, yawOf(forward), this.unit * 5));
    } else {
      for (const place of marks) layer.add(dot(place, this.unit * 0.2, color));
      if (from && to) layer.add(line(from, to, color));
    }
    this.scene.invalidate();
  }
}
