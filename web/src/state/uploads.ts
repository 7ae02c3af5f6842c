// Files on their way into image sets. They go on while other views are shown.
import { signal } from '@preact/signals';
import { ApiError, address, authorization, explain, patch, post, request } from '../api/client';
import type { Camera, Problem, UploadReport, UploadResult } from '../api/types';

const MAX_FILES = 8;
const MAX_BYTES = 48e6;

export interface Upload {
  files: number;
  bytes: number;
  /** Bytes that have left. */
  sent: number;
  running: boolean;
  /** One per file that is through, in order of arrival. */
  results: UploadResult[];
}

/** By image set. */
export const uploads = signal<Readonly<Record<string, Upload>>>({});

function change(set: string, how: (upload: Upload) => Upload): void {
  const none = { files: 0, bytes: 0, sent: 0, running: false, results: [] };
  uploads.value = { ...uploads.value, [set]: how(uploads.value[set] ?? none) };
}

export const forget = (set: string): void => {
  const { [set]: _, ...rest } = uploads.value;
  uploads.value = rest;
};

/** Photos, zips of photos, telemetry (csv) and the intrinsics of the camera (json). */
export async function upload(set: string, files: File[], done: () => void): Promise<void> {
  const total = files.reduce((sum, file) => sum + file.size, 0);
  change(set, (old) => ({
    ...(old.running ? old : { results: [], sent: 0, files: 0, bytes: 0 }),
    running: true,
    files: (old.running ? old.files : 0) + files.length,
    bytes: (old.running ? old.bytes : 0) + total,
  } as Upload));
  const of = (kind: Kind) => files.filter((file) => kindOf(file) === kind);
  for (const batch of batches(of('photo'))) {
    await step(set, batch, () => sendPhotos(set, batch));
    done();
  }
  // Telemetry names photos, also zipped ones: they have to be there.
  for (const file of [...of('zip'), ...of('csv'), ...of('json')]) await step(set, [file], () => sendOther(set, file));
  change(set, (old) => ({ ...old, running: false, sent: old.bytes }));
  done();
}

type Kind = 'photo' | 'zip' | 'csv' | 'json';

function kindOf(file: File): Kind {
  const extension = file.name.toLowerCase().split('.').pop();
  return extension === 'zip' || extension === 'csv' || extension === 'json' ? extension : 'photo';
}

function batches(files: File[]): File[][] {
  const all: File[][] = [];
  let bytes = Infinity;
  for (const file of files) {
    if (bytes + file.size > MAX_BYTES || all.at(-1)!.length >= MAX_FILES) {
      all.push([]);
      bytes = 0;
    }
    all.at(-1)!.push(file);
    bytes += file.size;
  }
  return all;
}

async function step(set: string, files: File[], send: () => Promise<UploadResult[]>): Promise<void> {
  let results: UploadResult[];
  const before = uploads.value[set]?.sent ?? 0;
  try {
    results = await send();
  } catch (error) {
    const { text, code, hint } = explain(error);
    const detail = hint ? `${text}: ${hint}` : text;
    results = files.map(({ name }) => ({ name, status: 'rejected', code: code ?? null, detail }));
  }
  const size = files.reduce((sum, file) => sum + file.size, 0);
  change(set, (old) => ({ ...old, results: [...old.results, ...results], sent: before + size }));
}

/** `fetch` does not tell how much has left, `XMLHttpRequest` does. */
function sendPhotos(set: string, files: File[]): Promise<UploadResult[]> {
  const form = new FormData();
  for (const file of files) form.append('image', file, file.name);
  const before = uploads.value[set]?.sent ?? 0;
  return new Promise((resolve, reject) => {
    const call = new XMLHttpRequest();
    call.open('POST', address('/v1/imagesets/{id}/images', { at: { id: set } }));
    for (const [name, value] of Object.entries(authorization())) call.setRequestHeader(name, value);
    call.upload.onprogress = ({ loaded }) => change(set, (old) => ({ ...old, sent: before + loaded }));
    call.onerror = () => reject(new Error('the connection was lost'));
    call.onload = () => {
      try {
        const answer = JSON.parse(call.responseText) as UploadReport | Problem;
        if ('results' in answer) resolve(answer.results);
        else reject(new ApiError(answer));
      } catch {
        reject(new Error(`the answer ${call.status} makes no sense`));
      }
    };
    call.send(form);
  });
}

async function sendOther(set: string, file: File): Promise<UploadResult[]> {
  const at = { id: set };
  switch (kindOf(file)) {
    case 'zip': {
      const headers = { 'Content-Type': 'application/zip' };
      const response = await request('POST', '/v1/imagesets/{id}/archive', file, { at, headers });
      return ((await response.json()) as UploadReport).results;
    }
    case 'csv': {
      const headers = { 'Content-Type': 'text/csv' };
      const response = await request('PUT', '/v1/imagesets/{id}/priors', file, { at, headers });
      const { updated, unknown } = (await response.json()) as { updated: number; unknown: string[] };
      const detail = `telemetry of ${updated} photos`;
      const warnings = unknown.length > 0 ? [`no photo is called ${unknown.slice(0, 3).join(', ')}${unknown.length > 3 ? ' …' : ''}`] : [];
      return [{ name: file.name, status: 'stored', detail, warnings }];
    }
    default: {
      const camera = await readCamera(file);
      const made = await post('/v1/cameras', { name: file.name, camera });
      await patch('/v1/imagesets/{id}', { camera_id: made.id }, { at });
      return [{ name: file.name, status: 'stored', detail: `camera ${camera.model} of all photos of the set` }];
    }
  }
}

async function readCamera(file: File): Promise<Camera> {
  const value = JSON.parse(await file.text()) as Partial<Camera>;
  const { model, width, height, params } = value;
  if (!model || !width || !height || !Array.isArray(params)) {
    throw new Error('a camera needs model, width, height and params');
  }
  return { model, width, height, params };
}
