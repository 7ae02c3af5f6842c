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

/** Crates that make codes. */
const CRATES = ['server', 'flight', 'pipeline', 'vision/formats', 'vision/localization', 'vision/registration', 'vision/scene', 'vision/sfm', 'vision/tracking'];
/** Types whose `code` names no failure but a kind, a state or a source. */
const NO_FAILURES = ['LegKind', 'FlightState', 'FocalSource', 'TrackState', 'PoseSource'];
/** Words that are no codes. A new one with an underscore belongs here or into docs/errors.md. */
const NO_CODES = `
  taking_off clock_held clock_runs taken_out timed_out map_metric free_space climb_speed yaw_rate max_distance
  depth_maps colmap_bin map_ids time_s yaw_deg pitch_deg roll_deg height_m x_m y_m zones focal_px focal_source capture_time_s
  obj_info binary_little_endian binary_big_endian vertex_indices end_header fl_x fl_y max_iterations
  exif_focal_plane sensor_table colmap`.trim().split(/\s+/);

function sources(crate) {
  return readdirSync(path.join(ROOT, crate, 'src'), { recursive: true })
    .filter((name) => name.endsWith('.rs') && !/tests?\.rs$|(^|\/)tests\//.test(name))
    .map((name) => `${crate}/src/${name}`);
}

/** The code of a crate without tests, comments and attributes. */
const program = (name) => read(name)
  .replace(/#\[cfg\(test\)\]\s*mod tests \{[^]*/, '')
  .replace(/^\s*\/\/.*$/gm, '')
  .replace(/#!?\[(?:"[^"]*"|[^\]"])*\]/g, '');

/** Words in quotes that look like codes: neither names of columns and fields, nor of metrics. */
function words(text) {
  const named = /"([a-z]+(?:_[a-z]+)+)"(?!\s*[:\]])/g;
  const isRead = /\b(?:try_get(?:::<.*>)?|field|required|column)\($/;
  return [...text.matchAll(named)]
    .filter(({ 1: word, index }) => !word.startsWith('volery_') && !isRead.test(text.slice(Math.max(0, index - 60), index)))
    .map((match) => match[1]);
}

/** What stands where a code belongs, also when it is a single word. */
function codesAt(text) {
  const found = [];
  const all = (pattern, among = text) => found.push(...[...among.matchAll(pattern)].map((match) => match[1]));
  const WORD = /"([a-z_]+)"/g;
  all(/\b(?:Conflict|Unprocessable|Worker|Refused|Unreadable|PipelineError::(?:new|plain))\(\s*"([a-z_]+)"/g);
  all(/\b(?:failure\(|reject\(app, name,|Err\(\()\s*"([a-z_]+)"/g);
  all(/\bcode: "([a-z_]+)"/g);
  all(/\breason = Some\("([a-z_]+)"/g);
  all(/\bcode\.unwrap_or_else\(\|\| "([a-z_]+)"/g);
  all(/map_or\("([a-z_]+)", \|\w+\| \w+\.code\(\)\)/g);
  all(/"([a-z_]+)",\s*S::/g);
  // let code = match … ;   let (code, detail) = if … ;
  for (const [, , body] of text.matchAll(/^( *)let (?:mut )?\(?(?:code|reason)\b[^=]*=([^]*?);\n(?=\1\S|\s*\})/gm)) all(WORD, body);
  // fn code(&self) -> &'static str { … }
  for (const { 1: name, 2: body, index } of text.matchAll(/fn (code|name|reason_of)\([^)]*\) -> &'static str \{([^]*?)\n {0,4}\}/g)) {
    const owner = [...text.slice(0, index).matchAll(/^impl (\w+)/gm)].pop()?.[1];
    if (name === 'name' ? owner === 'Alert' : !NO_FAILURES.includes(owner)) all(WORD, body);
  }
  // fn failure(code: &str, …), let bad = |code, …|: the argument at the place of `code`.
  for (const [, name, parameters] of text.matchAll(/\b(?:fn|let(?: mut)?) (\w+)(?: = )?[(|]([^)|]*\bcode\b[^)|]*)[)|]/g)) {
    const place = parameters.split(',').findIndex((parameter) => /^\s*code\b/.test(parameter));
    if (place >= 0 && name !== 'new') all(new RegExp(`\\b${name}\\((?:[^,()"]*,){${place}}\\s*"([a-z_]+)"`, 'g'));
  }
  // const FEW_POINTS: &str = "few_points";
  for (const [, name, word] of text.matchAll(/const (\w+): &str = "([a-z_]+)"/g)) if (name === word.toUpperCase()) found.push(word);
  // [("drift", …), …] … |(code, detail)|;   (frame, "overload") that is dropped;   (Some("repeated"), …) of a photo
  if (/\|\(code, \w+\)\|/.test(text)) all(/\(\s*"([a-z_]+)",/g);
  if (/\bdropped\b/.test(text)) all(/\(\w+, "([a-z_]+)"\)/g);
  if (/\blet \(reason, /.test(text)) all(/\(Some\("([a-z_]+)"\),/g);
  return found;
}

test('the list of error codes is the code’s', () => {
  const texts = CRATES.flatMap(sources).map(program);
  const inCode = new Set(texts.flatMap((text) => [...words(text), ...codesAt(text)]).filter((word) => !NO_CODES.includes(word)));
  assert.ok(inCode.size > 200, 'the patterns find the codes');
  const listed = [...read('docs/errors.md').matchAll(/^\| `([a-z_]+)` \|/gm)].map((match) => match[1]);
  assert.deepEqual([...inCode].filter((code) => !listed.includes(code)).sort(), [], 'are missing in docs/errors.md');
  assert.deepEqual(listed.filter((code) => !inCode.has(code)), [], 'are in docs/errors.md only');
  assert.deepEqual(listed.filter((code, k) => listed.indexOf(code) < k), [], 'are there twice');
  const all = texts.join('\n');
  assert.deepEqual(NO_CODES.filter((word) => !all.includes(`"${word}"`)), [], 'are excepted without need');
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
