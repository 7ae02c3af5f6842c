import { useEffect, useState } from 'preact/hooks';
import { blob, get, list, patch, remove } from '../../api/client';
import type { Image, ImageSet } from '../../api/types';
import { useLoad } from '../../state/load';
import { toastError } from '../../state/toasts';
import { upload, uploads } from '../../state/uploads';
import { Dialog } from '../../ui/dialog';
import { DropZone } from '../../ui/drop-zone';
import { Failure } from '../../ui/failure';
import { bytes, plural, when } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { NameField } from '../../ui/name-field';
import { Picture } from '../../ui/picture';
import { StartJob } from '../jobs/start-job';
import { Thumbnail } from './thumbnail';
import { UploadState } from './upload-state';
import '../../styles/photos.css';

const ACCEPT = '.jpg,.jpeg,.png,.zip,.csv,.json,image/jpeg,image/png';

interface SetData {
  set: ImageSet;
  images: Image[];
}

export function SetPage({ id }: { id: string }) {
  const { data, error, reload } = useLoad(async (signal): Promise<SetData> => {
    const options = { at: { id }, signal };
    const [set, images] = await Promise.all([
      get('/v1/imagesets/{id}', options),
      list('/v1/imagesets/{id}/images', options),
    ]);
    // Files that left together arrive in any order.
    images.sort((a, b) => a.name.localeCompare(b.name, 'en', { numeric: true }));
    return { set, images };
  }, [id]);
  const [starting, setStarting] = useState(false);
  const [shown, setShown] = useState<Image | null>(null);
  const through = uploads.value[id]?.results.length ?? 0;
  // What arrives while another view had started it.
  useEffect(() => {
    if (through > 0) reload();
  }, [through]);
  if (data === null) {
    return error === null
      ? <p class="muted center">Loading …</p>
      : <div class="page"><Failure error={error} retry={reload} /></div>;
  }
  const { set, images } = data;
  const rename = async (name: string) => {
    try {
      await patch('/v1/imagesets/{id}', { name }, { at: { id } });
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  const drop = async (image: Image) => {
    try {
      await remove('/v1/images/{id}', { at: { id: image.id } });
      setShown(null);
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  const withPrior = images.filter(({ prior }) => prior).length;
  return (
    <div class="page">
      <header class="page-head">
        <a class="muted" href="/photos">Photos</a>
        <span class="muted" aria-hidden="true">/</span>
        <NameField name={set.name} label="Name of the set" onSave={rename} />
        <button type="button" class="primary" disabled={images.length < 2} onClick={() => setStarting(true)}>
          <Icon name="maps" /> Make a map
        </button>
      </header>
      <p class="muted num">
        {plural(images.length, 'photo')}
        {images[0] && `, ${images[0].width} × ${images[0].height}`}
        {withPrior > 0 && `, ${withPrior} with telemetry`}
        {set.camera_id ? ', calibrated camera' : ', camera by EXIF or refined'}
      </p>
      <DropZone label="Drop more photos, or choose them" accept={ACCEPT} multiple onFiles={(files) => void upload(id, files, () => {})}>
        <p class="field-help">JPEG, PNG, zip; telemetry.csv; camera.json</p>
      </DropZone>
      <UploadState set={id} />
      <ul class="thumbnails">
        {images.map((image) => (
          <li key={image.id}>
            <button type="button" class="thumbnail" onClick={() => setShown(image)}>
              <Thumbnail image={image} />
              <span class="ellipsis">{image.name}</span>
            </button>
          </li>
        ))}
      </ul>
      {starting && <StartJob sets={[set]} images={images} onClose={() => setStarting(false)} />}
      {shown && (
        <Dialog title={shown.name} onClose={() => setShown(null)}>
          <Picture name={shown.id} alt={shown.name} load={() => blob('/v1/images/{id}/bytes', { at: { id: shown.id } })} />
          <footer class="row">
            <span class="muted grow num">
              {shown.width} × {shown.height}, {bytes(shown.size)}
              {shown.capture_time_ns != null && `, ${when(new Date(shown.capture_time_ns / 1e6).toISOString())}`}
            </span>
            <button type="button" onClick={() => void drop(shown)}>
              <Icon name="trash" /> Delete
            </button>
          </footer>
        </Dialog>
      )}
    </div>
  );
}
