// One way to the API: every request carries the token, every failure becomes an `ApiError`.
import type { paths } from './schema';
import type { Problem } from './types';
import { session, lock } from '../state/session';

type Method = 'get' | 'post' | 'put' | 'patch' | 'delete';
type PathsWith<M extends Method> = {
  [P in keyof paths]: paths[P][M] extends { responses: unknown } ? P : never;
}[keyof paths];
type Json<T> = T extends { content: { 'application/json': infer J } } ? J : never;
type Responses<P extends keyof paths, M extends Method> =
  paths[P][M] extends { responses: infer R } ? R : never;
type Answer<P extends keyof paths, M extends Method> = {
  [S in keyof Responses<P, M>]: S extends 200 | 201 | 202 ? Json<Responses<P, M>[S]> : never;
}[keyof Responses<P, M>];
type RequestBody<P extends keyof paths, M extends Method> =
  paths[P][M] extends { requestBody: infer B } ? Json<B> : undefined;
type Query<P extends keyof paths, M extends Method> =
  paths[P][M] extends { parameters: { query?: infer Q } } ? Q : undefined;

export interface Options<Q = unknown> {
  /** Values of the names in braces. */
  at?: Record<string, string | number>;
  query?: Q | undefined;
  headers?: Record<string, string>;
  signal?: AbortSignal;
}

/** What the service refused, in its own words. */
export class ApiError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
    this.name = 'ApiError';
  }
  get code(): string {
    return this.problem.code;
  }
  get hint(): string | undefined {
    return this.problem.hint ?? undefined;
  }
}

function offline(detail: string): ApiError {
  return new ApiError({
    type: 'about:blank',
    title: 'No answer',
    status: 0,
    code: 'no_answer',
    detail,
    hint: 'is the ground station running, and is this device on its network?',
  });
}

async function problemOf(response: Response): Promise<Problem> {
  const text = await response.text();
  try {
    const problem = JSON.parse(text) as Problem;
    if (typeof problem.code === 'string') return problem;
  } catch {
    // Not from the service itself: the status has to do.
  }
  return {
    type: 'about:blank',
    title: response.statusText,
    status: response.status,
    code: `http_${response.status}`,
    detail: text.slice(0, 300) || response.statusText,
  };
}

/** `/v1/maps/{id}` and `{id: ...}` to an address. */
export function address(path: string, options: Options = {}): string {
  const filled = path.replace(/\{(\w+)\}/g, (_, name: string) => {
    const value = options.at?.[name];
    if (value === undefined) throw new Error(`${path} needs ${name}`);
    return encodeURIComponent(value);
  });
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(options.query ?? {})) {
    if (value !== undefined && value !== null) query.set(name, String(value));
  }
  return query.size > 0 ? `${filled}?${query}` : filled;
}

export function authorization(): Record<string, string> {
  const token = session.token.value;
  return token ? { Authorization: `Bearer ${token}` } : {};
}

/** Any request; the typed functions below are what views use. */
export async function request(
  method: string,
  path: string,
  body?: BodyInit | null,
  options: Options = {},
): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(address(path, options), {
      method,
      body: body ?? null,
      headers: { ...authorization(), ...options.headers },
      signal: options.signal ?? null,
    });
  } catch (error) {
    if (options.signal?.aborted) throw error;
    throw offline('the ground station does not answer');
  }
  if (response.ok) return response;
  const problem = await problemOf(response);
  if (response.status === 401) lock(problem.detail);
  throw new ApiError(problem);
}

async function json<T>(method: string, path: string, body: unknown, options: Options): Promise<T> {
  const headers: Record<string, string> = { Accept: 'application/json', ...options.headers };
  if (body !== undefined) headers['Content-Type'] = 'application/json';
  const text = body === undefined ? null : JSON.stringify(body);
  const response = await request(method, path, text, { ...options, headers });
  return (response.status === 204 ? undefined : await response.json()) as T;
}

export function get<P extends PathsWith<'get'>>(path: P, options: Options<Query<P, 'get'>> = {}) {
  return json<Answer<P, 'get'>>('GET', path, undefined, options);
}

/** Repeated by accident, it is done once: each call has a key of its own. */
export function post<P extends PathsWith<'post'>>(
  path: P,
  body?: RequestBody<P, 'post'>,
  options: Options<Query<P, 'post'>> = {},
) {
  const headers = { 'Idempotency-Key': crypto.randomUUID(), ...options.headers };
  return json<Answer<P, 'post'>>('POST', path, body, { ...options, headers });
}

export function put<P extends PathsWith<'put'>>(
  path: P,
  body: RequestBody<P, 'put'>,
  options: Options<Query<P, 'put'>> = {},
) {
  return json<Answer<P, 'put'>>('PUT', path, body, options);
}

export function patch<P extends PathsWith<'patch'>>(
  path: P,
  body: RequestBody<P, 'patch'>,
  options: Options<Query<P, 'patch'>> = {},
) {
  return json<Answer<P, 'patch'>>('PATCH', path, body, options);
}

export function remove<P extends PathsWith<'delete'>>(path: P, options: Options = {}) {
  return json<undefined>('DELETE', path, undefined, options);
}

export async function blob<P extends keyof paths>(path: P, options: Options = {}): Promise<Blob> {
  return (await request('GET', path, null, options)).blob();
}

type Item<P extends PathsWith<'get'>> =
  Answer<P, 'get'> extends { items: (infer I)[] } ? I : never;

/** All pages of a list. */
export async function list<P extends PathsWith<'get'>>(
  path: P,
  options: Options<Query<P, 'get'>> = {},
): Promise<Item<P>[]> {
  const items: Item<P>[] = [];
  let cursor: string | null | undefined;
  do {
    const query = { limit: 500, ...(options.query as object), cursor };
    const page = await json<{ items: Item<P>[]; next_cursor?: string | null }>(
      'GET', path, undefined, { ...options, query });
    items.push(...page.items);
    cursor = page.next_cursor;
  } while (cursor);
  return items;
}

/** Any failure as a sentence with advice. */
export function explain(error: unknown): { text: string; code?: string; hint?: string | undefined } {
  if (error instanceof ApiError) {
    return { text: error.message, code: error.code, hint: error.hint };
  }
  return { text: error instanceof Error ? error.message : String(error) };
}
