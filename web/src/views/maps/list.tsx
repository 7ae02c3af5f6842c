import { useState } from 'preact/hooks';
import { list, remove } from '../../api/client';
import type { PlaceMap } from '../../api/types';
import { useLoad } from '../../state/load';
import { toast, toastError } from '../../state/toasts';
import { Confirm } from '../../ui/dialog';
import { Empty } from '../../ui/empty';
import { Failure } from '../../ui/failure';
import { count, when } from '../../ui/format';
import { Icon } from '../../ui/icons';
import { infoOf, sizeOf } from './map-info';
import { VerdictBadge, ScaleBadge } from './verdict';

export function MapList() {
  const { data, error, loading, reload } = useLoad(() => list('/v1/maps'), []);
  const [leaving, setLeaving] = useState<PlaceMap | null>(null);
  if (error !== null) return <div class="page"><Failure error={error} retry={reload} /></div>;
  if (data === null) return loading ? <p class="muted center">Loading …</p> : null;
  if (data.length === 0) {
    return (
      <Empty title="No maps yet" icon="maps">
        <p>A map is made of photos of a room: upload them, then start a reconstruction.</p>
        <a class="button primary" href="/photos">To the photos</a>
      </Empty>
    );
  }
  const drop = async (map: PlaceMap) => {
    try {
      await remove('/v1/maps/{id}', { at: { id: map.id } });
      toast('good', `${map.name} is deleted`);
      reload();
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <div class="page">
      <header class="page-head">
        <h1>Maps</h1>
      </header>
      <div class="card flush">
        <table>
          <thead>
            <tr>
              <th>Name</th>
              <th>Verdict</th>
              <th>Scale</th>
              <th class="end">Size</th>
              <th class="end">Photos</th>
              <th class="end">Triangles</th>
              <th class="end">Version</th>
              <th>Made</th>
              <th><span class="visually-hidden">Actions</span></th>
            </tr>
          </thead>
          <tbody>
            {[...data].reverse().map((map) => {
              const info = infoOf(map.active);
              const size = sizeOf(info);
              const unit = info.scale?.metric ? ' m' : '';
              return (
                <tr key={map.id}>
                  <td><a class="strong" href={`/maps/${map.id}`}>{map.name}</a></td>
                  <td><VerdictBadge info={info} /></td>
                  <td><ScaleBadge info={info} /></td>
                  <td class="end num">{size && size.map((side) => side.toFixed(1)).join(' × ') + unit}</td>
                  <td class="end num">{count(info.num_images ?? 0)}</td>
                  <td class="end num">{info.num_triangles ? count(info.num_triangles) : '–'}</td>
                  <td class="end num">{map.active_version}</td>
                  <td class="muted">{when(map.active.created)}</td>
                  <td class="end">
                    <button
                      type="button"
                      class="quiet icon-only"
                      aria-label={`Delete ${map.name}`}
                      onClick={() => setLeaving(map)}
                    >
                      <Icon name="trash" />
                    </button>
                  </td>
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
      {leaving && (
        <Confirm
          title={`Delete ${leaving.name}?`}
          action="Delete"
          onClose={() => setLeaving(null)}
          onYes={() => void drop(leaving)}
        >
          All {leaving.latest_version} versions of the map go. Photos and jobs stay.
        </Confirm>
      )}
    </div>
  );
}
