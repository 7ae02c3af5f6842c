import { Empty } from '../../ui/empty';

/** `rest`: the parts of the address after `/jobs`. */
export function Jobs({ rest: _ }: { rest: string[] }) {
  return <Empty title="Jobs" icon="jobs" />;
}
