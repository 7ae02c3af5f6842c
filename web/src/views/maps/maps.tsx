import { Empty } from '../../ui/empty';

/** `rest`: the parts of the address after `/maps`. */
export function Maps({ rest: _ }: { rest: string[] }) {
  return <Empty title="Maps" icon="maps" />;
}
