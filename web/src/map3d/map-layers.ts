// What a map consists of, as layers of a scene: `mesh`, `sparse`, `dense`. Each is loaded when it
// is first asked for.
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  FrontSide,
  type Mesh,
  Points,
  PointsMaterial,
  SRGBColorSpace,
} from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { request } from '../api/client';
import type { MapVersion } from '../api/types';
import { MAP_FROM_GLTF, vector } from './frames';
import { readPoints } from './ply';
import type { MapScene } from './scene';

export const MAP_LAYERS = ['mesh', 'dense', 'sparse'] as const;
export type MapLayer = (typeof MAP_LAYERS)[number];

const FILES: Record<MapLayer, string> = { mesh: 'map.glb', dense: 'dense.ply', sparse: 'sparse.ply' };
const POINT_PX: Record<'dense' | 'sparse', number> = { dense: 1.5, sparse: 2.5 };

/** The layers that a version of a map can show. */
export function layersOf(version: MapVersion): MapLayer[] {
  const has = (path: string) => version.files.some((file) => file.path === path);
  // Without a surface, map.glb holds points.
  const meshed = has('mesh.ply');
  return MAP_LAYERS.filter((layer) => has(FILES[layer]) && (layer !== 'mesh' || meshed));
}

/** What shows most of the map at least cost. */
export function firstLayer(version: MapVersion): MapLayer | undefined {
  const layers = layersOf(version);
  return layers.find((layer) => layer === 'mesh') ?? layers.find((layer) => layer === 'sparse') ?? layers[0];
}

/** Where a map is, by what it says of itself. */
export function boundsOf(version: MapVersion): Box3 {
  const [low, high] = (version.info as { bounds?: number[][] }).bounds ?? [];
  return low && high ? new Box3(vector(low), vector(high)) : new Box3();
}

/** Loads a layer unless it is there, and shows it. */
export async function showLayer(
  scene: MapScene,
  version: MapVersion,
  name: MapLayer,
  signal?: AbortSignal,
): Promise<void> {
  scene.show(name, true);
  const layer = scene.layer(name);
  const key = `${version.map_id}/${version.version}`;
  if (layer.userData.key === key) return;
  layer.userData.key = key;
  try {
    const response = await request('GET', '/v1/maps/{id}/export/{name}', null, {
      at: { id: version.map_id, name: FILES[name] },
      query: { version: version.version },
      ...(signal && { signal }),
    });
    const buffer = await response.arrayBuffer();
    const object = name === 'mesh' ? await surface(buffer) : cloud(buffer, POINT_PX[name]);
    if (signal?.aborted) return;
    scene.clear(name);
    layer.add(object);
    scene.invalidate();
  } catch (error) {
    layer.userData.key = undefined;
    throw error;
  }
}

async function surface(buffer: ArrayBuffer) {
  const { scene } = await new GLTFLoader().parseAsync(buffer, '');
  scene.quaternion.copy(MAP_FROM_GLTF);
  // From outside, walls are not seen, and clicks go through them: the room lies open.
  scene.traverse((part) => {
    const { material } = part as Partial<Mesh>;
    for (const one of material ? [material].flat() : []) one.side = FrontSide;
  });
  return scene;
}

function cloud(buffer: ArrayBuffer, size: number): Points {
  const { positions, colors } = readPoints(buffer);
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(positions, 3));
  geometry.setAttribute('color', new BufferAttribute(linear(colors), 3));
  const material = new PointsMaterial({ size, sizeAttenuation: false, vertexColors: true });
  return new Points(geometry, material);
}

/** Colors of pictures as three.js reckons with them. */
function linear(colors: Uint8Array): Float32Array {
  const table = Array.from({ length: 256 }, (_, value) =>
    new Color().setRGB(value / 255, 0, 0, SRGBColorSpace).r);
  return Float32Array.from(colors, (value) => table[value]!);
}
