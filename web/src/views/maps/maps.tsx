import { lazyView } from '../../ui/lazy';
import { MapList } from './list';

const MapPage = lazyView(() => import('./map-page').then((module) => module.MapPage));

/** `/maps`, `/maps/{id}`, `/maps/{id}/{version}`. */
export function Maps({ rest }: { rest: string[] }) {
  const [id, version] = rest;
  if (id === undefined) return <MapList />;
  return <MapPage key={`${id}/${version}`} id={id} version={version ? Number(version) : undefined} />;
}
