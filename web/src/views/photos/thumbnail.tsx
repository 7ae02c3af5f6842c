import { blob, get } from '../../api/client';
import type { Image, ImageSet } from '../../api/types';
import { useLoad } from '../../state/load';
import { Picture } from '../../ui/picture';

export function Thumbnail({ image }: { image: Image }) {
  return (
    <Picture
      lazy
      name={image.id}
      alt={image.name}
      load={() => blob('/v1/images/{id}/thumbnail', { at: { id: image.id } })}
    />
  );
}

/** The first photos of a set. */
export function SetCover({ set }: { set: ImageSet }) {
  const { data } = useLoad(
    (signal) => get('/v1/imagesets/{id}/images', { at: { id: set.id }, query: { limit: 3 }, signal }),
    [set.id, set.num_images]);
  return (
    <div class="cover">
      {data?.items.map((image) => <Thumbnail key={image.id} image={image} />)}
    </div>
  );
}
