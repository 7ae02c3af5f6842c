// Simulated drones, and the map and the poses that they need, over the API alone.
import { spawn } from 'node:child_process';
import { randomBytes } from 'node:crypto';
import { mkdtemp, rm, writeFile } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { createInterface } from 'node:readline';
import { startServer, until } from './harness.js';
import { CAMERA, photographRoom } from './room.js';

/** A station with a link to drones on a port of the system's choice. */
export async function startStation() {
  const folder = await mkdtemp(path.join(tmpdir(), 'volery-key-'));
  const key = randomBytes(32).toString('hex');
  await writeFile(path.join(folder, 'key'), key);
  const server = await startServer(['--mavlink', 'udp:127.0.0.1:0', '--mavlink-key', path.join(folder, 'key')]);
  const mavlink = await until(() => /heard on udp:(\S+)/.exec(server.said())?.[1]);
  const stop = async () => {
    await server.stop();
    await rm(folder, { recursive: true, force: true });
  };
  return { ...server, key, mavlink, stop };
}

/** A small metric map of the painted room: its active version, and its photos. */
export async function mapRoom(server, browser) {
  const photos = await photographRoom(browser, 8);
  return { ...await mapPhotos(server, photos, 'Room'), photos };
}

/** A map of photos of the room; its scale is the distance from the first to the last. */
export async function mapPhotos({ api }, photos, name) {
  const set = await api('POST', '/v1/imagesets', { name });
  const form = new FormData();
  for (const { name, type, bytes } of photos) form.append('file', new Blob([bytes], { type }), name);
  await api('POST', `/v1/imagesets/${set.id}/images`, form, null);
  const [a, b] = [photos[0], photos.at(-1)];
  const meters = Math.hypot(...a.position.map((value, k) => value - b.position[k]));
  const job = await api('POST', '/v1/jobs', {
    kind: 'reconstruct', imageset_ids: [set.id], preset: 'fast', camera: CAMERA, map_name: name,
    known_distances: [{ image_a: a.name, image_b: b.name, meters }],
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

/** The camera of a drone sees a photo, five times a second, until the returned function is called. */
export async function film(context, { address, token }, drone, map_id, { bytes }) {
  const tab = await context.newPage();
  await tab.goto(`${address}/docs`);
  await tab.evaluate(({ token, open, photo }) => {
    const socket = new WebSocket(`${location.origin.replace('http', 'ws')}/v1/ws`, ['volery', `bearer.${token}`]);
    socket.onopen = () => socket.send(JSON.stringify({ type: 'stream.open', ...open }));
    socket.onmessage = ({ data }) => {
      const { type, stream_id } = JSON.parse(data);
      if (type !== 'stream.opened') return;
      const bytes = Uint8Array.from(atob(photo), (char) => char.charCodeAt(0));
      let seq = 0;
      setInterval(() => {
        seq += 1;
        const header = new TextEncoder().encode(JSON.stringify({ stream_id, seq, t_capture_ns: seq * 2e8, encoding: 'png' }));
        const frame = new Uint8Array(8 + header.length + bytes.length);
        // Magic, version, kind, length of the header.
        frame.set([0x56, 0x59, 1, 1, header.length & 255, header.length >> 8]);
        frame.set(header, 8);
        frame.set(bytes, 8 + header.length);
        socket.send(frame);
      }, 200);
    };
  }, { token, open: { map_id, camera: CAMERA, track: true, drone_id: String(drone) }, photo: bytes.toString('base64') });
  return () => tab.close();
}
