// Everything a page about one version of a map needs to know.
import { get, list, request } from '../../api/client';
import { photosOf } from '../../api/photos';
import type { Camera, Image, MapVersion, PlaceMap } from '../../api/types';
import type { Placed } from '../../map3d/tour';
import type { Report, ReportImage } from './map-info';

export interface MapData {
  map: PlaceMap;
  version: MapVersion;
  /** Newest first. */
  versions: MapVersion[];
  placed: Placed[];
  unplaced: ReportImage[];
  report: Report | null;
}

export async function loadMap(id: string, wanted: number | undefined, signal: AbortSignal): Promise<MapData> {
  const options = { at: { id }, signal };
  const [map, versions] = await Promise.all([
    get('/v1/maps/{id}', options),
    list('/v1/maps/{id}/versions', options),
  ]);
  versions.sort((a, b) => b.version - a.version);
  const number = wanted ?? map.active_version;
  const version = versions.find((one) => one.version === number);
  if (!version) throw new Error(`the map has no version ${number}`);
  const query = { version: number };
  const [cameras, report, intrinsics] = await Promise.all([
    get('/v1/maps/{id}/cameras', { ...options, query }),
    readExport<Report>(version, 'report.json', signal),
    (version.info as { cameras?: unknown[] }).cameras?.length === 1
      ? null
      : readExport<Transforms>(version, 'transforms.json', signal),
  ]);
  const own = new Map(intrinsics?.frames.map((frame) => [nameOf(frame), cameraOf(frame)]));
  const shared = cameras.cameras[0];
  const placed = cameras.images.flatMap(({ image, pose }) => {
    const camera = own.get(image) ?? shared;
    return camera ? [{ name: image, pose, camera }] : [];
  });
  const unplaced = (report?.images ?? []).filter((image) => !image.registered);
  return { map, version, versions, placed, unplaced, report };
}

/** The photos of the map's cameras, by name. */
export const loadPhotos = (data: MapData): Promise<Map<string, Image>> =>
  photosOf(data.version, data.versions);

/** `null` when the version has no such file. */
async function readExport<T>(version: MapVersion, name: string, signal: AbortSignal): Promise<T | null> {
  if (!version.files.some(({ path }) => path === name)) return null;
  const options = { at: { id: version.map_id, name }, query: { version: version.version }, signal };
  const response = await request('GET', '/v1/maps/{id}/export/{name}', null, options);
  return (await response.json()) as T;
}

/** `transforms.json`: the only place that names the camera of each photo. */
interface Transforms {
  frames: Frame[];
}

interface Frame {
  file_path: string;
  w: number;
  h: number;
  fl_x: number;
  fl_y: number;
  cx: number;
  cy: number;
  k1?: number;
  k2?: number;
  p1?: number;
  p2?: number;
}

const nameOf = (frame: Frame): string => frame.file_path.replace(/^images\//, '');

const cameraOf = (frame: Frame): Camera => ({
  model: 'OPENCV',
  width: frame.w,
  height: frame.h,
  params: [
    frame.fl_x, frame.fl_y, frame.cx, frame.cy,
    frame.k1 ?? 0, frame.k2 ?? 0, frame.p1 ?? 0, frame.p2 ?? 0,
  ],
});
