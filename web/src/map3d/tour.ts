// Going from photo to photo: through a camera with its picture laid over the map, and along the
// way that the cameras took.
import { CatmullRomCurve3, type Mesh, MeshBasicMaterial, Quaternion, SRGBColorSpace, Texture, Vector3 } from 'three';
import { signal } from '@preact/signals';
import type { Camera, CameraPose } from '../api/types';
import { photoPlane, viewThrough } from './cameras';
import { threeOrientation, vector } from './frames';
import { dispose, type MapScene } from './scene';

export interface Placed {
  name: string;
  pose: CameraPose;
  camera: Camera;
}

const MOVE_S = 0.9;
const FADE_S = 0.5;
const SECONDS_PER_PHOTO = 0.6;
const LAYER = 'photo';

export class Tour {
  /** Along the way, in photos; not whole between two of them. */
  readonly at = signal(0);
  readonly playing = signal(false);
  /** How much of the photo covers the map. */
  readonly opacity = signal(1);
  private readonly way: CatmullRomCurve3 | null;
  private readonly turns: Quaternion[];
  private turn = 0;

  constructor(
    private readonly scene: MapScene,
    private readonly images: Placed[],
    private readonly depth: number,
  ) {
    const places = images.map((image) => vector(image.pose.position));
    this.way = places.length > 1 ? new CatmullRomCurve3(places, false, 'centripetal') : null;
    this.turns = images.map((image) => threeOrientation(image.pose));
  }

  /** Moves to a camera and lays its photo over what it sees; the photo before fades out. */
  async lookThrough(image: Placed, photo: Blob | null): Promise<void> {
    this.pause();
    const turn = ++this.turn;
    this.fadeOut();
    const bitmap = photo && (await createImageBitmap(photo, { imageOrientation: 'flipY' }));
    if (turn !== this.turn) return;
    await this.scene.flyTo(viewThrough(image.pose, image.camera, this.scene.camera.aspect), MOVE_S, 2 * this.depth);
    if (turn !== this.turn || !bitmap) return;
    const texture = new Texture(bitmap);
    texture.flipY = false;
    texture.colorSpace = SRGBColorSpace;
    texture.needsUpdate = true;
    const plane = photoPlane(image.pose, image.camera, texture, this.depth);
    this.scene.layer(LAYER).add(plane);
    this.fade(plane, this.opacity.value);
  }

  setOpacity(opacity: number): void {
    this.opacity.value = opacity;
    for (const plane of this.planes()) this.material(plane).opacity = opacity;
    this.scene.invalidate();
  }

  /** Takes the photo away. */
  leave(): void {
    this.turn++;
    this.fadeOut();
  }

  /** Goes to a place of the way. */
  seek(at: number): void {
    if (this.images.length === 0) return;
    const last = this.images.length - 1;
    const clamped = Math.min(Math.max(at, 0), last);
    const before = Math.min(Math.floor(clamped), Math.max(last - 1, 0));
    const after = Math.min(before + 1, last);
    const { camera } = this.scene;
    const place = this.way
      ? this.way.getPoint(clamped / last)
      : vector(this.images[0]!.pose.position);
    camera.position.copy(place);
    camera.quaternion.slerpQuaternions(this.turns[before]!, this.turns[after]!, clamped - before);
    const view = viewThrough(this.images[before]!.pose, this.images[before]!.camera, camera.aspect);
    this.scene.setFov(view.fov);
    this.aim();
    this.at.value = clamped;
    this.scene.invalidate();
  }

  play(): void {
    if (this.playing.value || this.images.length < 2) return;
    this.leave();
    this.playing.value = true;
    this.scene.controls.enabled = false;
    if (this.at.value >= this.images.length - 1) this.at.value = 0;
    this.scene.animate((seconds) => {
      if (!this.playing.value) return false;
      this.seek(this.at.value + seconds / SECONDS_PER_PHOTO);
      if (this.at.value >= this.images.length - 1) this.pause();
      return this.playing.value;
    });
  }

  pause(): void {
    if (!this.playing.value) return;
    this.playing.value = false;
    this.scene.controls.enabled = true;
  }

  /** The orbit goes on about what lies ahead. */
  private aim(): void {
    const { camera, controls } = this.scene;
    const forward = new Vector3(0, 0, -1).applyQuaternion(camera.quaternion);
    controls.target.copy(camera.position).addScaledVector(forward, 2 * this.depth);
  }

  private planes(): Mesh[] {
    return this.scene.layer(LAYER).children as Mesh[];
  }

  private material(plane: Mesh): MeshBasicMaterial {
    return plane.material as MeshBasicMaterial;
  }

  private fadeOut(): void {
    for (const plane of this.planes()) this.fade(plane, 0);
  }

  private fade(plane: Mesh, to: number): void {
    const material = this.material(plane);
    const from = material.opacity;
    let time = 0;
    plane.userData.fade = to;
    this.scene.animate((seconds) => {
      if (plane.userData.fade !== to) return false;
      time += seconds;
      const part = Math.min(time / FADE_S, 1);
      material.opacity = from + (to - from) * part;
      if (part < 1) return true;
      if (to === 0) {
        plane.removeFromParent();
        dispose(plane);
      }
      return false;
    });
  }
}
