// Which photos a map was made of, and their bytes.
import { ApiError, blob, get, list } from './client';
import type { Image, MapVersion } from './types';

/** Photos by name: those of the jobs that made this version and the versions it came from. */
export async function photosOf(version: MapVersion, versions: MapVersion[]): Promise<Map<string, Image>> {
  const photos = new Map<string, Image>();
  const seen = new Set<string>();
  const addSets = async (chain: MapVersion, of: MapVersion[]): Promise<void> => {
    for (let at: MapVersion | undefined = chain; at; at = parent(at, of)) {
      if (!at.job_id) continue;
      const job = await gone(get('/v1/jobs/{id}', { at: { id: at.job_id } }));
      for (const id of job?.request.imageset_ids ?? []) {
        if (seen.has(id)) continue;
        seen.add(id);
        const images = await gone(list('/v1/imagesets/{id}/images', { at: { id } }));
        for (const image of images ?? []) if (!photos.has(image.name)) photos.set(image.name, image);
      }
      for (const id of job?.request.map_ids ?? []) {
        if (seen.has(id)) continue;
        seen.add(id);
        const parts = await gone(list('/v1/maps/{id}/versions', { at: { id } }));
        for (const part of parts ?? []) await addSets(part, []);
      }
    }
  };
  await addSets(version, versions);
  return photos;
}

function parent(version: MapVersion, versions: MapVersion[]): MapVersion | undefined {
  return versions.find((other) => other.version === version.parent_version);
}

/** What has been deleted since is no failure. */
async function gone<T>(answer: Promise<T>): Promise<T | null> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof ApiError && error.problem.status === 404) return null;
    throw error;
  }
}

export const photoBytes = (image: Image): Promise<Blob> =>
  blob('/v1/images/{id}/bytes', { at: { id: image.id } });
