// From photos to a map that photos are found in, as a person does it in a browser.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { after, before, test } from 'node:test';
import { transformWithEsbuild } from 'vite';
import { clickAround, dropFiles, inspect, openPage, startBrowser, startServer, until } from './harness.js';
import { CAMERA, photographRoom } from './room.js';

let server, browser, page, complaints, photos;
/** Photos that make the map; the last one is looked for in it. */
const MAPPED = 11;

before(async () => {
  [server, browser] = await Promise.all([startServer(), startBrowser()]);
  photos = await photographRoom(browser, MAPPED + 1);
  ({ page, complaints } = await openPage(browser, server.address));
});

after(async () => {
  await browser?.close();
  await server?.stop();
});

const accessible = async (name) => assert.deepEqual(await inspect(page, name), []);
const button = (name, scope = page) => scope.getByRole('button', { name, exact: true });

test('a token lets in, a wrong one says why not, and none stays in the address', async () => {
  await page.goto('/');
  await page.getByLabel('Token').fill('vly_wrong');
  await button('Enter').click();
  await page.getByRole('alert').getByText('not valid').waitFor();
  await accessible('token');
  // Asking without a token is no defect of the page.
  assert.ok(complaints.every((text) => text.includes('401')), complaints.join('\n'));
  complaints.length = 0;
  await page.goto(`/maps#token=${server.token}`);
  await page.getByText('No maps yet').waitFor();
  assert.equal(new URL(page.url()).hash, '');
  await accessible('maps-empty');
  await page.goto('/jobs');
  await page.getByText('No jobs yet').waitFor();
  await page.reload();
  await page.getByText('No jobs yet').waitFor();
});

test('the keyboard reaches every area, and a switch changes the theme', async () => {
  await page.goto('/photos');
  await page.getByText('How to photograph a room').waitFor();
  await accessible('photos-empty');
  await page.keyboard.press('Tab');
  assert.equal(await page.evaluate(() => document.activeElement.textContent), 'Skip to content');
  for (const area of ['Volery', 'Photos', 'Jobs']) {
    await page.keyboard.press('Tab');
    assert.equal(await page.evaluate(() => document.activeElement.textContent), area);
  }
  await page.keyboard.press('Enter');
  await page.getByText('No jobs yet').waitFor();
  await button('Dark theme').click();
  assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), 'dark');
  await button('Light theme').click();
  await page.evaluate(() => localStorage.clear());
});

test('photos are dropped on the page, and a file that is none says why', async () => {
  await page.goto('/photos');
  const bad = { name: 'notes.jpg', type: 'image/jpeg', bytes: Buffer.from('no picture at all') };
  const camera = { name: 'camera.json', type: 'application/json', bytes: Buffer.from(JSON.stringify(CAMERA)) };
  await dropFiles(page, '.drop-zone', [...photos.slice(0, MAPPED), bad, camera]);
  const upload = page.getByLabel('Upload', { exact: true });
  await upload.getByText(`${MAPPED + 1} files stored, 1 refused`).waitFor();
  const refused = upload.locator('.refused');
  assert.equal(await refused.count(), 1);
  assert.match(await refused.textContent(), /notes\.jpg.*not_an_image/);
  await page.getByText(`${MAPPED} photos, ${CAMERA.width} × ${CAMERA.height}, calibrated camera`).waitFor();
  await page.waitForFunction((count) => document.querySelectorAll('.thumbnail img').length === count, MAPPED);
  await accessible('photos-set');
});

test('a job is started and watched to its end', async () => {
  await button('Make a map').click();
  await page.getByLabel('Name of the map').fill('painted room');
  await page.getByLabel('Fast').check();
  await accessible('job-start');
  await button('Start').click();
  await page.getByRole('heading', { name: 'painted room' }).waitFor();
  await page.getByRole('progressbar').waitFor();
  await page.getByText(/features|pairs|matching/).first().waitFor();
  await accessible('job-running');
  await page.getByRole('link', { name: 'Open the map' }).waitFor();
  await page.getByText(`${MAPPED} / ${MAPPED}`, { exact: true }).waitFor();
  await page.getByText('job succeeded').waitFor();
  await page.getByText('not_metric', { exact: true }).waitFor();
  await accessible('job-done');
  await page.goto('/jobs');
  await page.getByText('succeeded').waitFor();
  await accessible('jobs');
});

test('a job that runs tells its time, and one that runs again what it found finished', async () => {
  const set = await server.api('POST', '/v1/imagesets', { name: 'strangers' });
  const form = new FormData();
  for (const [name, bytes] of [['room.png', photos[0].bytes], ['page.png', await page.screenshot()]]) {
    form.append('file', new Blob([bytes], { type: 'image/png' }), name);
  }
  await server.api('POST', `/v1/imagesets/${set.id}/images`, form, null);
  const job = await server.api('POST', '/v1/jobs', { kind: 'reconstruct', imageset_ids: [set.id], preset: 'fast' });
  await page.goto(`/jobs/${job.id}`);
  await button('Run again').click();
  await page.getByText('2 found finished').first().waitFor();
  await button('Run again').waitFor();
  // A job of which no event comes: its time goes on all the same.
  const began = new Date(Date.now() - 60_000).toISOString();
  await page.route(`**/v1/jobs/${job.id}`, async (route) => {
    const now = await (await route.fetch()).json();
    await route.fulfill({ json: { ...now, state: 'running', started: began, finished: null } });
  });
  await page.reload();
  const time = page.getByText('running for 1 min');
  const first = await time.textContent();
  await until(async () => await time.textContent() !== first);
  await page.unrouteAll();
});

test('a map is opened, and a camera clicked shows its photo beside the map', async () => {
  await page.goto('/maps');
  await page.getByText('not metric').waitFor();
  await accessible('maps');
  await page.getByRole('link', { name: 'painted room' }).click();
  await page.waitForFunction(() => performance.getEntriesByName('map-sparse').length > 0);
  await accessible('map');
  const card = page.getByRole('region', { name: /^Photo / });
  await clickAround(page, () => card.isVisible());
  const pictures = card.locator('img');
  await pictures.nth(1).waitFor();
  for (const index of [0, 1]) {
    await page.waitForFunction((image) => image.naturalWidth > 0, await pictures.nth(index).elementHandle());
  }
  await accessible('map-photo');
  await button('Look through', card).click();
  await button('Photo after', card).click();
  await button('Close', card).click();
  await page.getByRole('tab', { name: 'Photos' }).click();
  await page.getByText(`Placed: ${MAPPED}`).waitFor();
  await accessible('map-photos');
  await page.getByRole('tab', { name: 'Export' }).click();
  await button('Download poses.csv').waitFor();
  await accessible('map-export');
});

test('the ruler measures, and a known length makes the map metric', async () => {
  await button('Show the whole map').click();
  await page.getByRole('tab', { name: 'Measure' }).click();
  await button('Ruler').click();
  const distance = page.locator('dd.big');
  await clickAround(page, () => distance.isVisible(), 90);
  assert.ok(Number.parseFloat(await distance.textContent()) > 0);
  assert.match(await distance.textContent(), /units/);
  await page.getByLabel('True length, meters').fill('2');
  await accessible('map-measure');
  const measured = Number.parseFloat(await distance.textContent());
  const id = new URL(page.url()).pathname.split('/')[2];
  await button('Set the scale').click();
  await page.waitForURL(/\/maps\/[^/]+\/2$/);
  await page.getByText(/^metric/).waitFor();
  await page.waitForFunction(() => performance.getEntriesByName('map-sparse').length > 1);
  // What was measured is two meters now, and so is all else.
  const flown = async (version) => {
    const { images } = await server.api('GET', `/v1/maps/${id}/cameras?version=${version}`);
    const [a, b] = ['room_00.png', 'room_10.png'].map((name) => images.find(({ image }) => image === name).pose.position);
    return Math.hypot(...a.map((value, k) => value - b[k]));
  };
  const grown = await flown(2) / await flown(1);
  assert.ok(Math.abs(grown * measured - 2) < 0.02, `${measured} units grew by ${grown}`);
});

test('a photo that is dropped on the map is found in it', async () => {
  await page.getByRole('tab', { name: 'Locate' }).click();
  await dropFiles(page, '.panel .drop-zone', [photos[MAPPED]]);
  await page.getByText('ok', { exact: true }).waitFor();
  await page.getByText('Uncertain by').waitFor();
  await accessible('map-locate');
});

test('nothing is drawn while nothing changes', async () => {
  const drawn = () => page.evaluate(() => performance.now() && window.__frames);
  await page.evaluate(() => {
    window.__frames = 0;
    const ask = window.requestAnimationFrame;
    window.requestAnimationFrame = (call) => {
      window.__frames += 1;
      return ask.call(window, call);
    };
  });
  // What was asked for before may still be drawn; then a second passes without a frame.
  for (let second = 0, before = -1; await drawn() !== before; second += 1) {
    assert.ok(second < 10, 'it draws and draws');
    before = await drawn();
    await page.waitForTimeout(1000);
  }
});

test('slow pictures take a third of the time, fast ones are drawn as they come', async () => {
  const source = new URL('../src/map3d/pace.ts', import.meta.url);
  const { code } = await transformWithEsbuild(await readFile(source, 'utf8'), source.pathname, { format: 'iife', globalName: 'pace' });
  const blank = await page.context().newPage();
  // A real fence, and times that are told.
  const ready = await blank.evaluate(`(async () => {
    ${code}
    const gl = document.createElement('canvas').getContext('webgl2');
    const one = new pace.Pace(gl);
    const draw = async (time) => {
      one.drawn(time);
      while (gl.clientWaitSync(one.fence, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise((done) => setTimeout(done));
    };
    const first = one.ready(0);
    await draw(0);
    const fast = one.ready(30);
    await draw(100);
    // It took 100 ms: from 100 to 400 nothing else is drawn.
    const slow = [200, 399, 400].map((time) => one.ready(time));
    return { first, fast, slow };
  })()`);
  await blank.close();
  assert.equal(ready.first, true);
  assert.equal(ready.fast, true);
  assert.deepEqual(ready.slow, [false, false, true]);
});

test('without a link to drones the page says how to get one', async () => {
  await page.goto('/fly');
  await page.getByText('No drone is heard').waitFor();
  await page.getByText('--mavlink').waitFor();
  assert.deepEqual(complaints, []);
});

test('all stop answers, and the console had nothing to complain of', async () => {
  await button('All stop').click();
  // Without a link to drones the service refuses, and the page says so.
  const report = page.locator('.stop-report');
  await report.getByText('did not arrive', { exact: false }).waitFor();
  await accessible('all-stop');
  assert.deepEqual(complaints.filter((text) => !text.includes('409')), []);
});
