import { Empty } from '../../ui/empty';

/** `rest`: the parts of the address after `/fly`. */
export function Fly({ rest: _ }: { rest: string[] }) {
  return <Empty title="Fly" icon="fly" />;
}
