// What is done with maps: made of a zip with telemetry, flown through, turned, joined.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { PLYLoader } from 'three/addons/loaders/PLYLoader.js';
import { mapPhotos } from './drones.js';
import { clickAround, dropFiles, inspect, openPage, startBrowser, startServer } from './harness.js';
import { CAMERA, photographRoom } from './room.js';
import { zip } from './zip.js';

let server, browser, page, complaints;
/** Of the left and of the right part of the room; none is in both. */
let left, right;

before(async () => {
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
  const photos = await photographRoom(browser, 18);
  left = photos.filter((_, k) => k % 2 === 0 && k <= 12);
  right = photos.filter((_, k) => k % 2 === 1 && k >= 5);
  ({ page, complaints } = await openPage(browser, server.address));
});

after(async () => {
  await browser?.close();
  await server?.stop();
});

const accessible = async (name) => assert.deepEqual(await inspect(page, name), []);
const button = (name) => page.getByRole('button', { name, exact: true });
const tab = (name) => page.getByRole('tab', { name }).click();
const camerasOf = async (id, version) => {
  const { images } = await server.api('GET', `/v1/maps/${id}/cameras?version=${version}`);
  return new Map(images.map(({ image, pose }) => [image, pose.position]));
};
const minus = (a, b) => a.map((value, k) => value - b[k]);
const inMap = () => new URL(page.url()).pathname.split('/')[2];

/** What a flight controller says of each photo. */
function telemetry(photos) {
  const rows = photos.map(({ name, position, target }) => {
    const [x, y, z] = minus(target, position);
    const degrees = (radians) => ((radians * 180) / Math.PI).toFixed(3);
    return [name, degrees(Math.atan2(x, y)), degrees(Math.atan2(z, Math.hypot(x, y))), 0, position[2].toFixed(3)];
  });
  return [['image', 'yaw_deg', 'pitch_deg', 'roll_deg', 'height_m'], ...rows].map((row) => `${row.join(',')}\n`).join('');
}

test('a zip with telemetry beside it becomes a metric map', async () => {
  await page.goto(`/photos#token=${server.token}`);
  await page.getByText('How to photograph a room').waitFor();
  const ghost = { ...left[0], name: 'ghost.png' };
  await dropFiles(page, '.drop-zone', [
    { name: 'telemetry.csv', type: 'text/csv', bytes: Buffer.from(telemetry([...left, ghost])) },
    { name: 'hall.zip', type: 'application/zip', bytes: zip([...left, { name: 'notes.txt', bytes: Buffer.from('no photo') }]) },
    { name: 'camera.json', type: 'application/json', bytes: Buffer.from(JSON.stringify(CAMERA)) },
  ]);
  const upload = page.getByLabel('Upload', { exact: true });
  await upload.getByText(`${left.length + 2} files stored`).waitFor();
  await upload.getByText(`telemetry of ${left.length} photos; no photo is called ghost.png`).waitFor();
  await page.getByText(`${left.length} photos, ${CAMERA.width} × ${CAMERA.height}, ${left.length} with telemetry`).waitFor();
  await page.getByRole('heading', { name: 'hall' }).waitFor();
  await accessible('photos-telemetry');
  await button('Make a map').click();
  await page.getByLabel('Fast').check();
  assert.ok(await page.getByLabel('Telemetry').isChecked(), 'telemetry gives the scale');
  await accessible('job-telemetry');
  await button('Start').click();
  await page.getByRole('link', { name: 'Open the map' }).click();
  await page.getByText(/^metric/).waitFor();
  const places = await camerasOf(inMap(), 1);
  assert.equal(places.size, left.length);
  const [a, b] = [left[0], left.at(-1)];
  const ratio = Math.hypot(...minus(places.get(a.name), places.get(b.name))) / Math.hypot(...minus(a.position, b.position));
  assert.ok(Math.abs(ratio - 1) < 0.03, `lengths are ${ratio} of the true ones`);
});

test('the view flies along the way of the cameras', async () => {
  const way = page.getByRole('group', { name: 'Along the way of the cameras' });
  const at = (photo) => way.getByText(`${photo} / ${left.length}`).waitFor();
  await at(1);
  await way.getByRole('button', { name: /^Fly along/ }).click();
  await at(4);
  await way.getByRole('button', { name: 'Pause' }).click();
  await accessible('map-way');
  await way.getByRole('button', { name: /^Fly along/ }).click();
  await at(left.length);
  await way.getByRole('button', { name: /^Fly along/ }).waitFor();
  const slider = way.getByRole('slider');
  await slider.focus();
  await page.keyboard.press('Home');
  await at(1);
  await page.keyboard.press('End');
  await at(left.length);
});

test('two clicks say where the origin is and where forward points', async () => {
  const id = inMap();
  await button('Show the whole map').click();
  await tab('Measure');
  await button('Origin').click();
  const set = button('Set origin and forward');
  await clickAround(page, () => set.isVisible());
  const words = page.getByRole('status').filter({ hasText: 'Forward turns by' });
  await clickAround(page, () => words.isVisible(), 28, 120);
  const yaw = (Number.parseFloat(/by (-?[\d.]+)/.exec(await words.textContent())[1]) * Math.PI) / 180;
  await accessible('map-frame');
  await set.click();
  await page.waitForURL(/\/maps\/[^/]+\/2$/);
  await page.getByText(/^metric/).waitFor();
  const [old, now] = [await camerasOf(id, 1), await camerasOf(id, 2)];
  // now = R(-yaw) (old - origin): the turn is the one told, lengths and heights stay.
  const turn = ([x, y, z]) => [Math.cos(yaw) * x + Math.sin(yaw) * y, -Math.sin(yaw) * x + Math.cos(yaw) * y, z];
  const shifts = [...old].map(([name, place]) => minus(now.get(name), turn(place)));
  for (const shift of shifts) assert.ok(Math.hypot(...minus(shift, shifts[0])) < 0.005, `${shift} and ${shifts[0]}`);
  // What was clicked is now zero: a point of the map is there.
  const points = await pointsOf(id, 2);
  assert.ok(Math.min(...points.map((point) => Math.hypot(...point))) < 0.1, 'a point is at the origin');
  assert.ok(points.some(([x, y]) => x > 0.2 && Math.abs(y) < 0.1), 'and one ahead of it');
  assert.ok(Math.abs(yaw) > 0.05, `forward turned by ${yaw}`);
  assert.ok(Math.hypot(...shifts[0]) > 0.1, 'it was not there before');
  await accessible('map-turned');
});

/** The sparse points of a version. */
async function pointsOf(id, version) {
  const answer = await fetch(`${server.address}/v1/maps/${id}/points?version=${version}`, {
    headers: { authorization: `Bearer ${server.token}` },
  });
  const place = new PLYLoader().parse(await answer.arrayBuffer()).getAttribute('position');
  return Array.from({ length: place.count }, (_, k) => [place.getX(k), place.getY(k), place.getZ(k)]);
}

test('two maps that share a part become one', async () => {
  await mapPhotos(server, right, 'right part');
  await page.goto('/jobs');
  await button('Join maps').click();
  const dialog = page.getByRole('dialog');
  const choice = (name) => dialog.getByLabel(name, { exact: false });
  assert.ok(await dialog.getByRole('button', { name: 'Join' }).isDisabled());
  await choice('right part').check();
  await dialog.getByText('keeps its frame').waitFor();
  await choice('hall').check();
  await dialog.getByLabel('Fast').check();
  await accessible('jobs-join');
  await dialog.getByRole('button', { name: 'Join' }).click();
  await page.getByRole('heading', { name: 'right part + hall' }).waitFor();
  await page.getByRole('link', { name: 'Open the map' }).click();
  await page.getByRole('group', { name: 'Along the way of the cameras' }).getByText(`1 / ${left.length + right.length}`).waitFor();
  const places = await camerasOf(inMap(), 1);
  // Across the seam lengths are true, too.
  const [a, b] = [left[0], right.at(-1)];
  const ratio = Math.hypot(...minus(places.get(a.name), places.get(b.name))) / Math.hypot(...minus(a.position, b.position));
  assert.ok(Math.abs(ratio - 1) < 0.03, `lengths are ${ratio} of the true ones`);
  await page.getByText('Photos', { exact: true }).locator('+ dd').getByText(String(places.size), { exact: true }).waitFor();
  await accessible('map-joined');
  await page.setViewportSize({ width: 1024, height: 768 });
  await accessible('map-tablet');
});

test('the console had nothing to complain of', () => {
  assert.deepEqual(complaints, []);
});
