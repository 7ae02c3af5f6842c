import { useState } from 'preact/hooks';
import { toastError } from '../../state/toasts';
import { download } from '../../ui/download';
import { bytes } from '../../ui/format';
import { Icon } from '../../ui/icons';
import type { MapData } from './map-data';

/** Exports by what they are for; others are packed of a `folder` when they are asked for. */
const EXPORTS: { name: string; text: string; folder?: string }[] = [
  { name: 'map.glb', text: 'For viewers and engines (glTF)' },
  { name: 'mesh.ply', text: 'Surface with colors' },
  { name: 'dense.ply', text: 'Dense cloud with normals' },
  { name: 'sparse.ply', text: 'Sparse points' },
  { name: 'poses.csv', text: 'Poses of the cameras' },
  { name: 'transforms.json', text: 'Poses for nerfstudio' },
  { name: 'colmap_bin.zip', text: 'COLMAP model, binary', folder: 'colmap/' },
  { name: 'colmap.zip', text: 'COLMAP model, text', folder: 'colmap/' },
  { name: 'zones.zip', text: 'Parts that nothing ties to the map, each a map', folder: 'zones/' },
  { name: 'freespace.bin', text: 'Where the air is free' },
  { name: 'report.html', text: 'Report with pictures' },
  { name: 'map.json', text: 'What the map says of itself' },
];

export function DownloadPanel({ data }: { data: MapData }) {
  const { version, map } = data;
  const sizes = new Map(version.files.map(({ path, size }) => [path, size]));
  const holds = (folder: string) => version.files.some(({ path }) => path.startsWith(folder));
  const [busy, setBusy] = useState<string | null>(null);
  const take = async (name: string) => {
    setBusy(name);
    try {
      const options = { at: { id: map.id, name }, query: { version: version.version } };
      const file = `${map.name.replace(/[^\w.-]+/g, '_')}-${version.version}-${name}`;
      await download('/v1/maps/{id}/export/{name}', options, file);
    } catch (error) {
      toastError(error);
    }
    setBusy(null);
  };
  return (
    <ul class="lines">
      {EXPORTS.filter(({ name, folder }) => (folder ? holds(folder) : sizes.has(name))).map(({ name, text }) => (
        <li key={name} class="row">
          <div class="grow">
            <div>{name} <span class="muted num">{sizes.has(name) && bytes(sizes.get(name)!)}</span></div>
            <p class="field-help">{text}</p>
          </div>
          <button
            type="button"
            class="icon-only"
            aria-label={`Download ${name}`}
            disabled={busy !== null}
            onClick={() => void take(name)}
          >
            <Icon name="download" />
          </button>
        </li>
      ))}
    </ul>
  );
}
