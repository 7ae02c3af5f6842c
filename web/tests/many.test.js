// Twenty drones ten times a second: the page keeps up, and keeps nothing. `VOLERY_LONG=1` watches a minute.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { mapRoom, startDrones, startStation } from './drones.js';
import { inspect, openPage, startBrowser, until } from './harness.js';

const DRONES = 20;
/** Messages of one second. */
const RATE = 10 * DRONES;
const SECONDS = process.env.VOLERY_LONG ? 60 : 10;
/** A heap goes up and down: it is as large as it is least, in each half of the time. */
const SAMPLES = 4;

let station, browser, drones, map;

before(async () => {
  station = await startStation();
  browser = await startBrowser();
  map = await mapRoom(station, browser);
  const [low, high] = map.info.bounds;
  drones = await startDrones(station, DRONES, [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]);
});

after(async () => {
  await drones?.stop();
  await browser?.close();
  await station?.stop();
});

test('memory does not grow with what drones say', async () => {
  const { page, complaints } = await openPage(browser, station.address);
  let messages = 0;
  let bytes = 0;
  /** By drone, when what it says was so, seconds. */
  const times = new Map();
  page.on('websocket', (socket) => socket.on('framereceived', ({ payload }) => {
    bytes += payload.length;
    if (!String(payload).includes('"drone.state"')) return;
    messages += 1;
    const { id, t_ns } = JSON.parse(payload).state;
    times.set(id, [...(times.get(id) ?? []), t_ns / 1e9]);
  }));
  await page.goto(`/fly/${map.map_id}#token=${station.token}`);
  await page.locator('.drone').nth(DRONES - 1).waitFor();
  const session = await page.context().newCDPSession(page);
  const heap = async () => {
    await session.send('HeapProfiler.collectGarbage');
    return (await session.send('Runtime.getHeapUsage')).usedSize;
  };
  const watch = (seconds) => {
    const end = messages + seconds * RATE;
    return until(() => messages >= end);
  };
  const least = async () => {
    const sizes = [];
    for (let k = 0; k < SAMPLES; k += 1) {
      await watch(SECONDS / 2 / SAMPLES);
      sizes.push(await heap());
    }
    return Math.min(...sizes);
  };
  // Code is compiled and lists are filled once.
  await watch(3);
  const start = bytes;
  const [earlier, later] = [await least(), await least()];
  const came = bytes - start;
  console.log(`${(came / 1e6).toFixed(1)} MB came; ${(earlier / 1e6).toFixed(2)} MB, then ${(later / 1e6).toFixed(2)} MB were held`);
  // Half of it came between the two: had it been kept, it would be there, and larger than as text.
  assert.ok(later - earlier < came / 4, `${later - earlier} of ${came} bytes stayed`);
  // Each drone is told ten times a second, none is left out. A busy machine may pause now and then.
  assert.equal(times.size, DRONES);
  for (const [id, told] of times) {
    const gaps = told.slice(1).map((time, k) => time - told[k]).sort((a, b) => a - b);
    const usual = gaps[Math.floor(gaps.length / 2)];
    assert.ok(Math.abs(usual - 0.1) < 0.015, `drone ${id} is told every ${usual.toFixed(3)} s`);
  }
  assert.deepEqual(await inspect(page, 'fly-twenty'), []);
  assert.deepEqual(complaints, []);
});
