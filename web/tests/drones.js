// Simulated drones, and the map and the poses that they need, over the API alone.
import { spawn } from 'node:child_process';
import { randomBytes } from 'node:crypto';
import { mkdtemp, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { createInterface } from 'node:readline';
import { PATIENCE_MS, startServer } from './harness.js';
import { CAMERA, photographRoom } from './room.js';

/** A station with a link to drones on a port of the system's choice. */
export async function startStation() {
  const folder = await mkdtemp(path.join(tmpdir(), 'volery-key-'));
  const key = randomBytes(32).toString('hex');
  await writeFile(path.join(folder, 'key'), key);
  const server = await startServer(['--mavlink', 'udp:127.0.0.1:0', '--mavlink-key', path.join(folder, 'key')]);
  const mavlink = await until(() => /heard on udp:(\S+)/.exec(server.said())?.[1]);
  const api = async (method, route, body, type = 'application/json') => {
    const answer = await fetch(server.address + route, {
      method,
      headers: { authorization: `Bearer ${server.token}`, ...(body && type && { 'content-type': type }) },
      body: type === 'application/json' && body ? JSON.stringify(body) : body,
    });
    const text = await answer.text();
    if (!answer.ok) throw new Error(`${method} ${route}: ${answer.status} ${text}`);
    return text && JSON.parse(text);
  };
  const stop = async () => {
    await server.stop();
    await rm(folder, { recursive: true, force: true });
  };
  return { ...server, key, mavlink, api, stop };
}

/** Asks until there is an answer. */
export async function until(ask, patience = PATIENCE_MS) {
  for (const end = Date.now() + patience; Date.now() < end; ) {
    const answer = await ask();
    if (answer) return answer;
    await new Promise((done) => setTimeout(done, 100));
  }
  throw new Error(`in vain: ${ask}`);
}

/** A small metric map of the painted room: its active version. */
export async function mapRoom({ api }, browser) {
  const set = await api('POST', '/v1/imagesets', { name: 'room' });
  const form = new FormData();
  for (const { name, type, bytes } of await photographRoom(browser, 8)) form.append('file', new Blob([bytes], { type }), name);
  await api('POST', `/v1/imagesets/${set.id}/images`, form, null);
  const job = await api('POST', '/v1/jobs', {
    kind: 'reconstruct', imageset_ids: [set.id], preset: 'fast', camera: CAMERA, map_name: 'Room',
    known_distances: [{ image_a: 'room_00.png', image_b: 'room_07.png', meters: 1.8 }],
  });
  const done = await until(async () => {
    const now = await api('GET', `/v1/jobs/${job.id}`);
    return ['succeeded', 'partial', 'failed'].includes(now.state) && now;
  });
  if (!done.outputs) throw new Error(`no map: ${JSON.stringify(done.error)}`);
  return (await api('GET', `/v1/maps/${done.outputs.map_id}`)).active;
}

/**
 * Drones on an open floor, whose own log of where they truly are is what they are told. `origin`:
 * the first one's place in the map; the others stand a meter and a half beside.
 */
export async function startDrones({ address, token, key, mavlink }, count, origin) {
  const child = spawn(process.env.VOLERY_BIN, [
    'simulate', '--drones', count, '--flavor', 'mixed', '--room', 'open', '--mavlink', mavlink, '--key', key,
    '--start', '0,0,0', '--spacing', '0,1.5,0', '--report', '10',
  ].map(String), { stdio: ['ignore', 'pipe', 'inherit'] });
  const truth = new Map();
  createInterface(child.stdout).on('line', (line) => {
    const drone = JSON.parse(line);
    if (!drone.position) return;
    truth.set(drone.system_id, drone);
    const pose = {
      // Two poses are never the same: a camera that shows one picture again and again is broken.
      position: drone.position.map((value, k) => value + origin[k] + 0.002 * Math.random()),
      orientation: [Math.cos(drone.yaw / 2), 0, 0, Math.sin(drone.yaw / 2)],
      age_ms: 20, position_sd: 0.02, angle_sd: 0.02,
    };
    fetch(`${address}/v1/drones/${drone.system_id}/pose`, {
      method: 'POST', body: JSON.stringify(pose),
      headers: { authorization: `Bearer ${token}`, 'content-type': 'application/json' },
      // A drone that is not heard yet takes none.
    }).then((answer) => answer.arrayBuffer()).catch(() => {});
  });
  return {
    truth,
    async stop() {
      const ended = new Promise((done) => child.once('exit', done));
      child.kill('SIGTERM');
      await ended;
    },
  };
}
