import { useEffect } from 'preact/hooks';
import { pages } from 'virtual:docs';
import { Empty } from '../../ui/empty';
import { lazyView } from '../../ui/lazy';
import '../../styles/docs.css';

const Routes = lazyView(() => import('./routes').then((module) => module.Routes));
const KEYS = [
  ['Shift+Space, or Escape twice', 'All stop, from every view'],
  ['Arrow keys, + and −', 'Move and zoom the map that has the focus'],
  ['Tab, Enter, Escape', 'Next control, use it, close a dialog'],
];

/** The documents, beside a menu of them. */
export function Book({ name }: { name: string }) {
  const page = pages.find((page) => page.name === name);
  const entries = [...pages.map(({ name, title }) => ({ name, title })), { name: 'routes', title: 'Routes' }, { name: 'keys', title: 'Keys' }];
  useEffect(() => {
    if (location.hash) document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
  }, [name]);
  return (
    <div class="page book">
      <nav aria-label="Documents">
        {entries.map((entry) => (
          <a key={entry.name} href={`/docs/${entry.name}`} aria-current={entry.name === name ? 'page' : undefined}>
            {entry.title}
          </a>
        ))}
      </nav>
      <Text page={page} name={name} />
    </div>
  );
}

function Text({ page, name }: { page: (typeof pages)[number] | undefined; name: string }) {
  // Our own text, made when the page was built.
  if (page) return <article key={name} class="prose" dangerouslySetInnerHTML={{ __html: page.html }} />;
  if (name === 'routes') return <Routes />;
  if (name === 'keys') {
    return (
      <article class="prose">
        <h1>Keys</h1>
        <table>
          <tbody>{KEYS.map(([keys, what]) => <tr key={keys}><th scope="row">{keys}</th><td>{what}</td></tr>)}</tbody>
        </table>
      </article>
    );
  }
  return <Empty title="There is no such document" icon="docs" />;
}
