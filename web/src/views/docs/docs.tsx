import { Empty } from '../../ui/empty';

/** `rest`: the parts of the address after `/docs`. */
export function Docs({ rest: _ }: { rest: string[] }) {
  return <Empty title="Docs" icon="docs" />;
}
