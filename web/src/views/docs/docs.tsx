import { lazyView } from '../../ui/lazy';

const Book = lazyView(() => import('./book').then((module) => module.Book));

/** `rest`: the name of a document. */
export function Docs({ rest: [name = 'capture'] }: { rest: string[] }) {
  return <Book name={name} />;
}
