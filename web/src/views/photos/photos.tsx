import { SetList } from './set-list';
import { SetPage } from './set-page';

/** `/photos`, `/photos/{id}`. */
export function Photos({ rest }: { rest: string[] }) {
  const [id] = rest;
  return id === undefined ? <SetList /> : <SetPage key={id} id={id} />;
}
