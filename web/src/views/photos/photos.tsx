import { Empty } from '../../ui/empty';

/** `rest`: the parts of the address after `/photos`. */
export function Photos({ rest: _ }: { rest: string[] }) {
  return <Empty title="Photos" icon="photos" />;
}
