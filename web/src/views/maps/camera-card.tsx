import { request } from '../../api/client';
import type { Placed } from '../../map3d/tour';
import { Icon } from '../../ui/icons';
import { Picture } from '../../ui/picture';
import type { MapViewer } from './viewer';

/** The chosen photo beside what the map shows from the same camera. */
export function CameraCard({ viewer }: { viewer: MapViewer }) {
  const index = viewer.chosen.value;
  const placed = index === null ? undefined : viewer.data.placed[index];
  if (index === null || !placed) return null;
  const photos = viewer.photos.value;
  const photo = photos?.get(placed.name);
  const count = viewer.data.placed.length;
  const go = (step: number) => void viewer.lookThrough((index + step + count) % count);
  return (
    <section class="camera-card" aria-label={`Photo ${placed.name}`}>
      <header class="row">
        <button type="button" class="quiet icon-only" aria-label="Photo before" onClick={() => go(-1)}>
          <Icon name="back" />
        </button>
        <strong class="grow ellipsis" title={placed.name}>{placed.name}</strong>
        <button type="button" class="quiet icon-only" aria-label="Photo after" onClick={() => go(1)}>
          <Icon name="next" />
        </button>
        <button type="button" class="quiet icon-only" aria-label="Close" onClick={() => viewer.choose(null)}>
          <Icon name="close" />
        </button>
      </header>
      <div class="pair">
        <figure>
          {photo ? (
            <Picture name={photo.id} alt={`Photo ${placed.name}`} load={async () => (await viewer.photoOf(index))!} />
          ) : (
            <div class="picture muted">{photos ? 'The photo is not kept any more' : ''}</div>
          )}
          <figcaption>Photo</figcaption>
        </figure>
        <figure>
          <Picture
            name={placed.name}
            alt={`The map from the camera of ${placed.name}`}
            load={() => render(viewer, placed)}
          />
          <figcaption>Map from the same camera</figcaption>
        </figure>
      </div>
      <div class="row">
        <button type="button" onClick={() => void viewer.lookThrough(index)}>
          Look through
        </button>
        <label class="check grow">
          <span>Photo over map</span>
          <input
            type="range"
            class="grow"
            min={0}
            max={1}
            step={0.05}
            value={viewer.tour.opacity.value}
            onInput={(event) => viewer.tour.setOpacity(Number(event.currentTarget.value))}
          />
        </label>
      </div>
    </section>
  );
}

async function render(viewer: MapViewer, { pose, camera }: Placed): Promise<Blob> {
  const { map_id, version } = viewer.data.version;
  const body = JSON.stringify({ pose, camera, what: 'color' });
  const options = {
    at: { id: map_id },
    query: { version },
    headers: { 'Content-Type': 'application/json' },
  };
  return (await request('POST', '/v1/maps/{id}/render', body, options)).blob();
}
