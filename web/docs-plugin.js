// The documents of ../docs as the module `virtual:docs`, made when the page is built.
import { readFileSync } from 'node:fs';
import path from 'node:path';
import { fileURLToPath } from 'node:url';
import { Marked } from 'marked';

const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), '..');
/** In the order of the menu. */
const PAGES = ['capture', 'safety', 'frames-and-units', 'api', 'errors'];

const slug = (text) => text.toLowerCase().replace(/<[^>]*>|[^\w\s-]/g, '').trim().replace(/\s+/g, '-');

/** One page; pictures become imports, so that the build names them by their content. */
function page(name, pictures) {
  const text = readFileSync(path.join(ROOT, 'docs', `${name}.md`), 'utf8');
  const title = /^# (.+)$/m.exec(text)?.[1] ?? name;
  const marked = new Marked({
    renderer: {
      heading({ tokens, depth }) {
        const words = this.parser.parseInline(tokens);
        return `<h${depth} id="${slug(words)}">${words}</h${depth}>\n`;
      },
      image({ href, text }) {
        pictures.push(path.join(ROOT, 'docs', href));
        return `<img src="volery:picture-${pictures.length - 1}" alt="${text}" loading="lazy">`;
      },
      link({ href, tokens }) {
        const words = this.parser.parseInline(tokens);
        const inner = /^([\w-]+)\.md(#.*)?$/.exec(href);
        if (inner && PAGES.includes(inner[1])) return `<a href="/docs/${inner[1]}${inner[2] ?? ''}">${words}</a>`;
        if (href.endsWith('openapi.yaml')) return `<a href="/docs/routes">${words}</a>`;
        // What lies beside the page in the repository is not served.
        return /^(https?:|#)/.test(href) ? `<a href="${href}" rel="noreferrer">${words}</a>` : words;
      },
      table(token) {
        const row = (cells, tag) => `<tr>${cells.map((cell) => `<${tag}>${this.parser.parseInline(cell.tokens)}</${tag}>`).join('')}</tr>`;
        return `<div class="wide" tabindex="0"><table><thead>${row(token.header, 'th')}</thead><tbody>${token.rows.map((cells) => row(cells, 'td')).join('')}</tbody></table></div>\n`;
      },
      code({ text }) {
        const escaped = text.replace(/&/g, '&amp;').replace(/</g, '&lt;');
        return `<pre tabindex="0"><code>${escaped}</code></pre>\n`;
      },
    },
  });
  return { name, title, html: marked.parse(text) };
}

function docs(watch) {
  const pictures = [];
  const pages = PAGES.map((name) => page(name, pictures));
  for (const name of PAGES) watch(path.join(ROOT, 'docs', `${name}.md`));
  const imports = pictures.map((file, k) => `import p${k} from ${JSON.stringify(`${file}?url`)};`).join('\n');
  const names = pictures.map((_, k) => `p${k}`).join(', ');
  return `${imports}
const pictures = [${names}];
const put = (html) => html.replace(/volery:picture-(\\d+)/g, (_, k) => pictures[k]);
export const pages = ${JSON.stringify(pages)}.map((page) => ({ ...page, html: put(page.html) }));`;
}

export function documents() {
  const name = 'virtual:docs';
  return {
    name: 'volery-documents',
    resolveId: (id) => (id === name ? `\0${name}` : null),
    load(id) {
      return id === `\0${name}` ? docs((file) => this.addWatchFile(file)) : null;
    },
  };
}
