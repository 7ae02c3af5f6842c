// What a version of a map says of itself (`map.json`), and what its report says of each photo.
import type { MapVersion } from '../../api/types';

export interface MapInfo {
  scale?: { metric: boolean; source: string; sigma_rel: number | null };
  gravity?: { source: string; sigma: number | null };
  origin?: string;
  quality?: { verdict: Verdict; reasons: { code: string; detail: string }[] };
  num_images?: number;
  num_points?: number;
  num_dense_points?: number | null;
  num_triangles?: number | null;
  bounds?: [number[], number[]];
}

export type Verdict = 'good' | 'suspect' | 'failed';

export interface ReportImage {
  name: string;
  registered: boolean;
  reason: string | null;
  detail: string | null;
  duplicate_of: string | null;
  num_features: number;
  num_observations: number;
  reprojection_px: number | null;
}

export interface Report {
  num_images?: number;
  /** Only of maps that are made of photos, not of other maps. */
  num_registered?: number;
  mean_reprojection_px?: number;
  mean_track_length?: number;
  images?: ReportImage[];
  stages?: { name: string; wall_s: number; units: number; cached: number }[];
  quality?: MapInfo['quality'];
  warnings?: { code: string; detail: string; hint?: string }[];
  advice?: string[];
  wall_s?: number;
}

export const infoOf = (version: MapVersion): MapInfo => version.info as MapInfo;

export const TONES: Record<Verdict, 'good' | 'warn' | 'bad'> = {
  good: 'good',
  suspect: 'warn',
  failed: 'bad',
};

/** The size of a map in its own unit. */
export function sizeOf(info: MapInfo): [number, number, number] | null {
  const [low, high] = info.bounds ?? [];
  if (!low || !high) return null;
  return [0, 1, 2].map((axis) => high[axis]! - low[axis]!) as [number, number, number];
}
