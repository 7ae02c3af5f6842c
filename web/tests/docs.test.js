// The documents tell the truth: every error code is listed, every example of the API is valid. Their
// commands and Python snippets are run by client_sdk/python/tests.
import assert from 'node:assert/strict';
import { existsSync, readFileSync, readdirSync } from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';
import yaml from 'js-yaml';

const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), '../..');
const read = (name) => readFileSync(path.join(ROOT, name), 'utf8');
const DOCUMENTS = ['README.md', ...readdirSync(path.join(ROOT, 'docs')).filter((name) => name.endsWith('.md')).map((name) => `docs/${name}`)];

/** Types whose `code` names no failure but a kind, a state or a source. */
const NO_FAILURES = ['LegKind', 'FlightState', 'FocalSource', 'TrackState', 'PoseSource'];
const CRATES = ['server', 'flight', 'pipeline', 'vision/formats', 'vision/localization', 'vision/registration', 'vision/scene', 'vision/tracking'];

function sources(crate) {
  return readdirSync(path.join(ROOT, crate, 'src'), { recursive: true })
    .filter((name) => name.endsWith('.rs') && !/tests?\.rs$|(^|\/)tests\//.test(name))
    .map((name) => `${crate}/src/${name}`);
}

function codesOf(name) {
  const text = read(name).replace(/#\[cfg\(test\)\]\s*mod tests \{[^]*/, '');
  const found = [];
  const all = (pattern, among = text) => found.push(...[...among.matchAll(pattern)].map((match) => match[1]));
  all(/\b(?:Conflict|Unprocessable|Worker|Refused)\(\s*"([a-z_]+)"/g);
  all(/\bcode: "([a-z_]+)"/g);
  all(/PipelineError::(?:new|plain)\(\s*"([a-z_]+)"/g);
  for (const { 0: body, index } of text.matchAll(/fn code\(&?self\) -> &'static str \{[^]*?\n    \}/g)) {
    const owner = [...text.slice(0, index).matchAll(/^impl (\w+)/gm)].pop()?.[1];
    if (!NO_FAILURES.includes(owner)) all(/"([a-z_]+)"/g, body);
  }
  if (name === 'server/src/error.rs') all(/\(\s*"([a-z_]+)",\s*S::/g);
  if (name === 'pipeline/src/error.rs') all(/: &str = "([a-z_]+)"/g);
  return found;
}

test('the list of error codes is the code’s', () => {
  const inCode = new Set(CRATES.flatMap(sources).flatMap(codesOf));
  assert.ok(inCode.size > 100, 'the patterns find the codes');
  const listed = [...read('docs/errors.md').matchAll(/^\| `([a-z_]+)` \|/gm)].map((match) => match[1]);
  assert.deepEqual([...inCode].filter((code) => !listed.includes(code)).sort(), [], 'are missing in docs/errors.md');
  const text = CRATES.flatMap(sources).map(read).join('\n');
  assert.deepEqual(listed.filter((code) => !text.includes(`"${code}"`)), [], 'are in docs/errors.md only');
});

/** Code blocks of a language, with the file that they are in. */
function blocks(languages) {
  return DOCUMENTS.flatMap((name) =>
    [...read(name).matchAll(/^```(\w+)\n([^]*?)^```/gm)]
      .filter(([, language]) => languages.includes(language))
      .map(([, , text]) => ({ name, text })));
}

const api = yaml.load(read('openapi.yaml'));
const resolve = (schema) => (schema.$ref ? api.components.schemas[schema.$ref.split('/').pop()] : schema);

/** Schemas of which one has to fit: choices are listed, and parts put together. */
function alternatives(given) {
  const schema = resolve(given);
  const choices = schema.oneOf ?? schema.anyOf;
  if (choices) return choices.flatMap(alternatives);
  if (!schema.allOf) return [schema];
  const join = (a, b) => ({
    type: 'object',
    properties: { ...a.properties, ...b.properties },
    required: [...(a.required ?? []), ...(b.required ?? [])],
  });
  return schema.allOf.map(alternatives).reduce((ways, part) => ways.flatMap((way) => part.map((one) => join(way, one))), [{}]);
}

/** What is wrong with `value`: the parts of JSON Schema that openapi.yaml uses. */
function faults(value, given, at = '$') {
  const schema = resolve(given);
  const ways = alternatives(schema);
  if (ways.length > 1) return ways.map((way) => faults(value, way, at)).sort((a, b) => a.length - b.length)[0];
  if (schema.allOf) return faults(value, ways[0], at);
  const types = [schema.type ?? []].flat();
  const kind = value === null ? 'null' : Array.isArray(value) ? 'array' : typeof value;
  const fits = types.length === 0 || types.includes(kind) || (kind === 'number' && types.includes('integer') && Number.isInteger(value));
  if (!fits) return [`${at} is ${kind}, not ${types}`];
  const found = [];
  if (schema.enum && !schema.enum.includes(value)) found.push(`${at} is none of ${schema.enum}`);
  if (kind === 'number' && (value < schema.minimum || value > schema.maximum)) found.push(`${at} is out of range`);
  if (kind === 'array') {
    if (value.length < schema.minItems || value.length > schema.maxItems) found.push(`${at} has ${value.length} items`);
    if (schema.items) value.forEach((item, k) => found.push(...faults(item, schema.items, `${at}[${k}]`)));
  }
  if (kind === 'object' && schema.properties) {
    for (const name of schema.required ?? []) if (!(name in value)) found.push(`${at} has no ${name}`);
    for (const [name, item] of Object.entries(value)) {
      if (schema.properties[name]) found.push(...faults(item, schema.properties[name], `${at}.${name}`));
      else if (schema.additionalProperties !== true) found.push(`${at} must not have ${name}`);
    }
  }
  return found;
}

/** `METHOD /path` and the JSON after it, or a message of the socket. */
function schemaOf(heading) {
  const [method, route] = heading.split(' ');
  if (method === 'SEND') return api.components.schemas.ClientMessage;
  if (method === 'RECEIVE') return api.components.schemas.ServerMessage;
  const known = Object.entries(api.paths).find(([template]) =>
    new RegExp(`^${template.replace(/\{\w+\}/g, '[^/]+')}$`).test(route.split('?')[0]));
  return known?.[1][method.toLowerCase()]?.requestBody?.content['application/json']?.schema;
}

test('every example of the API is valid', () => {
  const examples = blocks(['http', 'json']);
  assert.ok(examples.length > 4, 'there are some');
  for (const { name, text } of examples) {
    const end = text.indexOf('\n');
    const heading = text.slice(0, end);
    const schema = schemaOf(heading);
    assert.ok(schema, `${name}: openapi.yaml does not know the body of ${heading}`);
    assert.deepEqual(faults(JSON.parse(text.slice(end)), schema), [], `${name}: ${heading}`);
  }
});

test('the examples’ judge has teeth', () => {
  const command = { $ref: '#/components/schemas/DroneCommand' };
  assert.deepEqual(faults({ type: 'takeoff', height: 1 }, command), []);
  assert.notDeepEqual(faults({ type: 'takeoff' }, command), []);
  assert.notDeepEqual(faults({ type: 'fly' }, command), []);
  assert.notDeepEqual(faults({ drones: [], ttl_ms: 1 }, { $ref: '#/components/schemas/CreateLease' }), []);
});

test('links and pictures of the documents lead somewhere', () => {
  for (const name of DOCUMENTS) {
    for (const [, target] of read(name).matchAll(/\]\((?!https?:|#)([^)#\s]+)/g)) {
      assert.ok(existsSync(path.join(ROOT, path.dirname(name), target)), `${name}: ${target}`);
    }
  }
});
