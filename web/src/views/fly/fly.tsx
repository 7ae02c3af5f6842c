import { useEffect } from 'preact/hooks';
import { list } from '../../api/client';
import type { PlaceMap } from '../../api/types';
import { followFleet } from '../../state/fleet';
import { useLoad } from '../../state/load';
import { navigate } from '../../state/router';
import { Empty } from '../../ui/empty';
import { Failure } from '../../ui/failure';
import { lazyView } from '../../ui/lazy';
import { infoOf } from '../maps/map-info';

const Stage = lazyView(() => import('./stage').then((module) => module.Stage));

/** `rest`: the id of the map that is flown in. */
export function Fly({ rest: [id] }: { rest: string[] }) {
  const maps = useLoad((signal) => list('/v1/maps', { signal }), []);
  const usable = maps.data?.filter((map) => map.active);
  const map = id ? usable?.find((map) => map.id === id) : usable?.find(isMetric) ?? usable?.[0];
  useEffect(followFleet, []);
  useEffect(() => {
    if (!id && map) navigate(`/fly/${map.id}`, 'replace');
  }, [id, map]);

  if (maps.error) return <div class="page"><Failure error={maps.error} retry={maps.reload} /></div>;
  if (!usable) return <p class="muted center">Loading …</p>;
  if (!map?.active) {
    return (
      <Empty title={id ? 'There is no such map' : 'Drones fly in a map'} icon="maps">
        <p>Make one from photos first; it has to be in meters.</p>
        <a class="button primary" href="/photos">To the photos</a>
      </Empty>
    );
  }
  return <Stage key={`${map.id}/${map.active.version}`} version={map.active} maps={usable} />;
}

export const isMetric = ({ active }: PlaceMap): boolean => active ? infoOf(active).scale?.metric === true : false;
