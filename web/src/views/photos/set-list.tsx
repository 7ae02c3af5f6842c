import { useEffect, useState } from 'preact/hooks';
import { list, post, remove } from '../../api/client';
import type { ImageSet } from '../../api/types';
import { useLoad } from '../../state/load';
import { navigate } from '../../state/router';
import { toast, toastError } from '../../state/toasts';
import { upload } from '../../state/uploads';
import { Confirm } from '../../ui/dialog';
import { DropZone } from '../../ui/drop-zone';
import { Failure } from '../../ui/failure';
import { count, plural, when } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { SetCover } from './thumbnail';
import '../../styles/photos.css';

const ACCEPT = '.jpg,.jpeg,.png,.zip,.csv,.json,image/jpeg,image/png';

const LOOK_EVERY_MS = 5000;

/** All image sets; files that are dropped become a new one. */
export function SetList() {
  const { data, error, reload } = useLoad(() => list('/v1/imagesets'), []);
  const [leaving, setLeaving] = useState<ImageSet | null>(null);
  useEffect(() => {
    // Scripts and others bring photos, too.
    const timer = setInterval(() => document.hidden || reload(), LOOK_EVERY_MS);
    return () => clearInterval(timer);
  }, []);
  const make = async (files: File[]) => {
    try {
      const set = await post('/v1/imagesets', { name: nameFor(files) });
      navigate(`/photos/${set.id}`);
      void upload(set.id, files, () => {});
    } catch (error) {
      toastError(error);
    }
  };
  const drop = async (set: ImageSet) => {
    try {
      await remove('/v1/imagesets/{id}', { at: { id: set.id } });
      toast('good', `${set.name} is deleted`);
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <div class="page">
      <header class="page-head">
        <h1>Photos</h1>
        {data && data.length > 0 && <span class="muted">{plural(data.length, 'set')}</span>}
      </header>
      <DropZone label="Drop the photos of a room here, or choose them" accept={ACCEPT} multiple onFiles={(files) => void make(files)}>
        <p class="field-help">
          JPEG or PNG, also zipped; with them telemetry.csv and camera.json if you have them. They
          become a new set.
        </p>
      </DropZone>
      {error !== null && <Failure error={error} retry={reload} />}
      {data?.length === 0 && <FirstSteps />}
      <ul class="sets">
        {[...(data ?? [])].reverse().map((set) => (
          <li key={set.id} class="card set">
            <a href={`/photos/${set.id}`} aria-label={set.name}>
              <SetCover set={set} />
            </a>
            <div class="row">
              <div class="grow">
                <a class="strong ellipsis" href={`/photos/${set.id}`}>{set.name}</a>
                <div class="muted">{count(set.num_images)} photos, {when(set.created)}</div>
              </div>
              <button type="button" class="quiet icon-only" aria-label={`Delete ${set.name}`} onClick={() => setLeaving(set)}>
                <Icon name="trash" />
              </button>
            </div>
          </li>
        ))}
      </ul>
      {leaving && (
        <Confirm
          title={`Delete ${leaving.name}?`}
          action="Delete"
          onClose={() => setLeaving(null)}
          onYes={() => void drop(leaving)}
        >
          Its {plural(leaving.num_images, 'photo')} go. Maps that were made of them stay.
        </Confirm>
      )}
    </div>
  );
}

/** Before the first photo: what good photos are. */
function FirstSteps() {
  return (
    <section class="card stack">
      <h2>How to photograph a room</h2>
      <ul class="bullets">
        <li>Each photo shares more than half of what it shows with the one before.</li>
        <li>Move while turning: a circle of 0.3 m, steps of at most 15°. A turn on the spot makes no map.</li>
        <li>Stop and shoot, or turn slower than 10° per second: sharp photos match.</li>
        <li>White walls need something to see: posters, tape, tools.</li>
        <li>Measure one distance in the room, or record the height of the drone: that gives the map its scale.</li>
      </ul>
      <p><a href="/docs/capture">More in the guide</a></p>
    </section>
  );
}

/** After the photos, or the day. */
function nameFor(files: File[]): string {
  const zip = files.find(({ name }) => name.toLowerCase().endsWith('.zip'));
  if (zip) return zip.name.slice(0, -4);
  const now = new Date();
  const two = (n: number) => String(n).padStart(2, '0');
  const day = `${now.getFullYear()}-${two(now.getMonth() + 1)}-${two(now.getDate())}`;
  return `Photos of ${day} ${two(now.getHours())}:${two(now.getMinutes())}`;
}
