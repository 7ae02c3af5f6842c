import { createContext } from 'preact';
import { useContext, useState } from 'preact/hooks';
import { load } from 'js-yaml';
import { request } from '../../api/client';
import { useLoad } from '../../state/load';
import { Failure } from '../../ui/failure';

interface Schema {
  $ref?: string;
  type?: string | string[];
  description?: string;
  properties?: Record<string, Schema>;
  required?: string[];
  items?: Schema;
  oneOf?: Schema[];
  allOf?: Schema[];
  enum?: (string | null)[];
}

interface Body {
  content?: Record<string, { schema?: Schema }>;
}

interface Operation {
  tags?: string[];
  summary?: string;
  parameters?: { name: string; in: string; description?: string; required?: boolean; schema?: Schema }[];
  requestBody?: Body;
  responses?: Record<string, Body & { description?: string }>;
}

interface Api {
  paths: Record<string, Record<string, Operation>>;
  components: { schemas: Record<string, Schema> };
}

const Schemas = createContext<Record<string, Schema>>({});

const METHODS = ['get', 'post', 'put', 'patch', 'delete', 'head'];

/** All routes of the service that answers, with what they take and answer. */
export function Routes() {
  const { data, error, reload } = useLoad(async (signal) => {
    const answer = await request('GET', '/openapi.yaml', null, { signal });
    return load(await answer.text()) as Api;
  }, []);
  if (error !== null) return <Failure error={error} retry={reload} />;
  if (data === null) return <p class="muted center">Loading …</p>;
  return <Schemas.Provider value={data.components.schemas}><RouteList api={data} /></Schemas.Provider>;
}

function RouteList({ api }: { api: Api }) {
  const [wanted, setWanted] = useState('');
  const operations = Object.entries(api.paths).flatMap(([path, item]) =>
    METHODS.filter((method) => item[method]).map((method) => ({ path, method, operation: item[method]! })));
  const text = wanted.trim().toLowerCase();
  const shown = operations.filter(({ path, method, operation }) =>
    `${method} ${path} ${operation.summary ?? ''}`.toLowerCase().includes(text));
  const tags = [...new Set(shown.map(({ operation }) => operation.tags?.[0] ?? 'other'))];
  return (
    <article class="prose">
      <h1>Routes</h1>
      <p>
        From <a href="/openapi.yaml" target="_blank" rel="noreferrer">openapi.yaml</a>. Every route may also answer{' '}
        <code>application/problem+json</code> with one of the <a href="/docs/errors">error codes</a>.
      </p>
      <label>
        Find
        <input type="search" value={wanted} placeholder="drones, POST, geofence …" onInput={(event) => setWanted(event.currentTarget.value)} />
      </label>
      {tags.map((tag) => (
        <section key={tag}>
          <h2>{tag}</h2>
          {shown.filter(({ operation }) => (operation.tags?.[0] ?? 'other') === tag).map(({ path, method, operation }) => (
            <details key={`${method} ${path}`}>
              <summary>
                <span class="method">{method.toUpperCase()}</span> <code>{path}</code> <span class="muted">{operation.summary}</span>
              </summary>
              <Details operation={operation} />
            </details>
          ))}
        </section>
      ))}
      {shown.length === 0 && <p class="muted">No route has “{wanted}”.</p>}
    </article>
  );
}

function Details({ operation }: { operation: Operation }) {
  return (
    <div class="operation">
      {operation.parameters && (
        <table>
          <tbody>
            {operation.parameters.map(({ name, in: place, description }) => (
              <tr key={name}><th scope="row"><code>{name}</code></th><td class="muted">{place}</td><td>{description}</td></tr>
            ))}
          </tbody>
        </table>
      )}
      <Content title="Takes" body={operation.requestBody} />
      {Object.entries(operation.responses ?? {}).filter(([status]) => status !== 'default').map(([status, body]) => (
        <Content key={status} title={`Answers ${status}: ${body.description ?? ''}`} body={body} />
      ))}
    </div>
  );
}

function Content({ title, body }: { title: string; body: Body | undefined }) {
  if (!body) return null;
  const kinds = Object.entries(body.content ?? {});
  return (
    <>
      <h3>{title}</h3>
      {kinds.map(([kind, { schema }]) => (
        <div key={kind}>
          <p class="muted">{kind}</p>
          {schema && kind.includes('json') && <SchemaView schema={schema} depth={0} />}
        </div>
      ))}
    </>
  );
}

const nameOf = (schema: Schema) => schema.$ref?.split('/').pop();

function typeOf(schema: Schema): string {
  const name = nameOf(schema);
  if (name) return name;
  if (schema.oneOf) return schema.oneOf.map(typeOf).join(' or ');
  if (schema.items) return `list of ${typeOf(schema.items)}`;
  if (schema.enum) return schema.enum.join(' | ');
  return [schema.type ?? 'object'].flat().join(' or ');
}

/** Fields of an object; what they refer to is opened on demand. */
function SchemaView({ schema, depth }: { schema: Schema; depth: number }) {
  const name = nameOf(schema);
  const schemas = useContext(Schemas);
  const known = name ? schemas[name] : schema;
  if (!known || depth > 6) return null;
  if (known.items) return <SchemaView schema={known.items} depth={depth} />;
  const parts = known.oneOf ?? known.allOf;
  if (parts) return <>{parts.map((part, k) => <SchemaView key={k} schema={part} depth={depth + 1} />)}</>;
  if (!known.properties) return known.description ? <p>{known.description}</p> : null;
  return (
    <table class="fields">
      <caption>{known.description ?? name}</caption>
      <tbody>
        {Object.entries(known.properties).map(([field, value]) => (
          <tr key={field}>
            <th scope="row"><code>{field}</code>{known.required?.includes(field) ? '' : ' ?'}</th>
            <td class="muted">{typeOf(value)}</td>
            <td>
              {value.description}
              <Inner value={value} depth={depth} />
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Inner({ value, depth }: { value: Schema; depth: number }) {
  const [open, setOpen] = useState(false);
  const target = [value, value.items, ...(value.oneOf ?? [])].find((one) => one?.$ref);
  if (!target) return null;
  return (
    <details onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{nameOf(target)}</summary>
      {open && <SchemaView schema={target} depth={depth + 1} />}
    </details>
  );
}
