// Drones fly by the page: found, named, fenced, sent by a click, refused, watched, stopped.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { film, mapRoom, startDrones, startStation } from './drones.js';
import { inspect, openPage, startBrowser, until } from './harness.js';

let station, browser, drones, map, center, floor;
/** Where the first drone stands, from the middle: its ways lead ahead, so that it need not turn. */
const START = [-1.8, -0.75];

before(async () => {
  station = await startStation();
  browser = await startBrowser();
  map = await mapRoom(station, browser);
  const [low, high] = map.info.bounds;
  center = [0, 1].map((k) => (low[k] + high[k]) / 2);
  floor = low[2];
  drones = await startDrones(station, 2, [center[0] + START[0], center[1] + START[1], floor]);
  const ready = async () => (await station.api('GET', '/v1/drones')).items.filter(({ state }) => state?.feed === 'ready').length === 2;
  await until(ready);
});

after(async () => {
  await drones?.stop();
  await browser?.close();
  await station?.stop();
});

const stateOf = (id) => station.api('GET', `/v1/drones/${id}/state`);

test('a drone is found, named, fenced, sent, refused, watched and stopped', async () => {
  const { page, complaints } = await openPage(browser, station.address);
  const serious = [];
  const tab = (name) => page.getByRole('tab', { name }).click();
  const type = async (label, value) => {
    await page.getByLabel(label, { exact: true }).fill(String(value));
    await page.getByLabel(label, { exact: true }).blur();
  };
  await page.goto(`/fly#token=${station.token}`);
  await page.locator('.drone').nth(1).waitFor();

  // A name and a tilted camera.
  await page.getByRole('button', { name: 'Register Drone 1' }).click();
  await type('Name', 'Wren');
  await type('down', 20);
  serious.push(...await inspect(page, 'fly-register'));
  await page.getByRole('button', { name: 'Save' }).click();
  await page.getByRole('button', { name: 'Settings of Wren' }).waitFor();
  const { body_from_camera } = await station.api('GET', '/v1/drones/1');
  const [w, x, y, z] = body_from_camera.orientation;
  const ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z];
  const wanted = [Math.cos(Math.PI / 9), 0, -Math.sin(Math.PI / 9)];
  ahead.forEach((value, k) => assert.ok(Math.abs(value - wanted[k]) < 1e-9, `looks along ${ahead}`));
  serious.push(...await inspect(page, 'fly-drones'));

  // A fence of 6 m by 6 m, by its corners.
  await tab('Fence');
  await page.getByRole('button', { name: 'Box' }).first().click();
  for (const side of [-3, 3]) {
    await type('x', center[0] + side);
    await type('y', center[1] + side);
    await page.getByRole('button', { name: 'Add corner' }).click();
  }
  await type('From height of Area, meters', floor - 0.3);
  await type('to height of Area, meters', floor + 3);
  await page.getByRole('button', { name: 'Save the fence' }).click();
  await page.getByRole('button', { name: 'Save the fence' }).waitFor({ state: 'detached' });
  const [fence] = await station.api('GET', '/v1/geofences');
  assert.equal(fence.area.outline.length, 4);
  serious.push(...await inspect(page, 'fly-fence'));

  // Outside of it nothing flies, and the page says why.
  await tab('Flight');
  await type('x of Wren', center[0] + 9);
  await page.getByRole('button', { name: 'Plan and check' }).click();
  await page.getByText('This does not fly.').waitFor();
  await page.getByText('out_of_fence').waitFor();
  serious.push(...await inspect(page, 'fly-refused'));
  // The answer that the console tells of was wanted.
  assert.match(complaints.splice(0).join(), /^[^,]*422[^,]*$/);

  // A click is a target at the height asked for.
  const canvas = await page.locator('.scene canvas').boundingBox();
  await page.mouse.click(canvas.x + canvas.width / 2, canvas.y + canvas.height / 2);
  const target = async (axis) => Number(await page.getByLabel(`${axis} of Wren`, { exact: true }).inputValue());
  await until(async () => Math.abs(await target('x') - (center[0] + 9)) > 1);
  assert.ok(Math.abs(await target('z') - (floor + 1.2)) < 0.02);
  const place = [center[0] - 1, center[1] + START[1]];
  await type('x of Wren', place[0].toFixed(2));
  await type('y of Wren', place[1].toFixed(2));
  await type('Speed, m/s', 1);
  await page.getByRole('button', { name: 'Plan and check' }).click();
  await page.getByText('Inside the fence').waitFor();
  assert.equal((await stateOf(1)).armed, false, 'a plan moves nobody');
  serious.push(...await inspect(page, 'fly-planned'));
  await page.getByRole('button', { name: 'Fly', exact: true }).click();
  // Meanwhile poses of the other one that cannot be are told in one line, which goes with them.
  const alerts = page.getByRole('alert', { name: 'Alerts' });
  const elsewhere = { position: [center[0], center[1], floor + 9], orientation: [1, 0, 0, 0], age_ms: 20, position_sd: 0.02, angle_sd: 0.02 };
  await until(async () => {
    await station.api('POST', '/v1/drones/2/pose', elsewhere).catch(() => {});
    return alerts.getByText(/[2-9] times/).isVisible();
  });
  assert.equal(await alerts.getByText('pose_refused').count(), 1);
  serious.push(...await inspect(page, 'fly-alert'));
  await page.getByText('Arrived').waitFor();
  await alerts.waitFor({ state: 'detached' });
  const [px, py] = (await stateOf(1)).estimate.position;
  assert.ok(Math.hypot(px - place[0], py - place[1]) < 0.3, `arrived at ${px}, ${py}`);
  serious.push(...await inspect(page, 'fly-arrived'));

  // In the air it goes on to the next target by a way of its own: refused first, then flown.
  await page.getByRole('button', { name: 'New flight' }).click();
  await type('x of Wren', center[0] + 9);
  await page.getByRole('button', { name: 'Plan and check' }).click();
  const checks = page.getByRole('list', { name: 'Checks' });
  await checks.getByText('The drone can be steered').waitFor();
  assert.match(await checks.locator('.bad').textContent(), /fence/);
  assert.ok(await page.getByRole('button', { name: 'Fly', exact: true }).isDisabled());
  serious.push(...await inspect(page, 'fly-target-refused'));
  const next = center[0] - 0.3;
  await type('x of Wren', next.toFixed(2));
  await page.getByRole('button', { name: 'Plan and check' }).click();
  await checks.getByText('Inside the fence').waitFor();
  const before = (await stateOf(1)).estimate.position;
  assert.ok(Math.hypot(before[0] - px, before[1] - py) < 0.2, 'a plan moves nobody');
  serious.push(...await inspect(page, 'fly-target'));
  await page.getByRole('button', { name: 'Fly', exact: true }).click();
  await page.getByText('Arrived').waitFor();
  assert.ok(Math.abs((await stateOf(1)).estimate.position[0] - next) < 0.3);

  // While drones are in the air, the start shows them.
  const start = await page.context().newPage();
  await start.goto(`/#token=${station.token}`);
  await start.getByText('Wren').first().waitFor();
  await start.close();

  // A group, stopped on its way by the keys.
  await page.getByRole('button', { name: 'New flight' }).click();
  const end = center[0] + 2;
  await type('x of Wren', end.toFixed(2));
  await page.getByRole('button', { name: 'Drone 2' }).click();
  await type('y of Drone 2', (center[1] + 2).toFixed(2));
  await page.getByRole('button', { name: 'Plan and check' }).click();
  await page.getByText('Nearest approach').waitFor();
  await page.getByRole('button', { name: 'Fly', exact: true }).click();
  await until(async () => Math.hypot(...(await stateOf(1)).estimate.velocity) > 0.2);
  await page.keyboard.press('Shift+Space');
  const report = page.getByRole('alert', { name: 'All stop' });
  await report.getByText('Wren holds where it is').waitFor().catch(async () => assert.fail(await report.textContent()));
  serious.push(...await inspect(page, 'fly-stopped'));
  const held = (await until(async () => {
    const state = await stateOf(1);
    return Math.hypot(...state.estimate.velocity) < 0.05 && state;
  })).estimate.position;
  const still = await until(async () => {
    const { estimate, flying, t_ns } = await stateOf(1);
    assert.ok(flying);
    return t_ns > 0 && estimate.position;
  });
  assert.ok(Math.hypot(...held.map((value, k) => value - still[k])) < 0.15);
  assert.ok(Math.abs(held[0] - end) > 0.5, 'it held on its way');

  // What came of it stays until it is closed.
  await report.getByRole('button', { name: 'Close' }).click();
  await report.waitFor({ state: 'detached' });

  // Without the fence, flights keep to the map again.
  await tab('Fence');
  await page.getByRole('button', { name: 'Delete the fence' }).click();
  serious.push(...await inspect(page, 'fly-fence-delete'));
  await page.getByRole('dialog').getByRole('button', { name: 'Delete', exact: true }).click();
  await page.getByText('Without a fence').waitFor();
  assert.deepEqual(await station.api('GET', '/v1/geofences'), []);

  // What its camera sees, beside the map as it should see it.
  const endOfFilm = await film(page.context(), station, 1, map.map_id, map.photos[3]);
  await tab('Drones');
  await page.getByRole('button', { name: 'Wren', exact: true }).click();
  await page.getByRole('button', { name: 'View from Wren' }).click();
  for (const picture of ['What Wren sees', 'The map from the place of Wren']) {
    await until(() => page.getByAltText(picture).evaluate((image) => image.naturalWidth > 0));
  }
  serious.push(...await inspect(page, 'fly-camera'));
  await page.getByRole('button', { name: 'Close the view' }).click();
  await endOfFilm();

  // On a tablet.
  await page.setViewportSize({ width: 1024, height: 768 });
  await tab('Drones');
  serious.push(...await inspect(page, 'fly-tablet'));
  assert.deepEqual(complaints, []);
  assert.deepEqual(serious, []);
});

test('the documents are on the page', async () => {
  const { page, complaints } = await openPage(browser, station.address);
  const serious = [];
  await page.goto(`/docs/frames-and-units#token=${station.token}`);
  const menu = page.getByRole('navigation', { name: 'Documents' });
  await menu.waitFor();
  const names = await menu.getByRole('link').evaluateAll((links) => links.map((link) => new URL(link.href).pathname.split('/').pop()));
  for (const name of ['capture', 'safety', 'api', 'errors', 'routes', 'keys']) assert.ok(names.includes(name), name);
  for (const name of names) {
    await page.goto(`/docs/${name}`);
    await page.getByRole('article').getByRole('heading', { level: 1 }).waitFor();
    if (name === 'routes') await page.getByText('/v1/all-stop').first().waitFor();
    serious.push(...await inspect(page, `docs-${name}`));
  }
  await page.goto('/docs/frames-and-units');
  const drawn = page.locator('.prose img').first();
  await until(() => drawn.evaluate((image) => image.naturalWidth > 0));
  await page.getByRole('link', { name: 'Safety' }).click();
  await page.getByRole('heading', { name: 'What Volery cannot know' }).waitFor();
  assert.deepEqual(complaints, []);
  assert.deepEqual(serious, []);
});
