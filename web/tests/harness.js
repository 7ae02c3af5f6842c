// A real ground station, a real browser, and what every test of the page asks of it.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdir, mkdtemp, readFile, rm } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { createInterface } from 'node:readline';
import { chromium } from 'playwright-core';

const require = createRequire(import.meta.url);
const BROWSER = process.env.CHROMIUM ?? '/usr/bin/chromium';
const ARGS = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader', '--disable-gpu-compositing',
  // A page that does not come from the server may open its socket all the same: see `openPage`.
  '--disable-features=LocalNetworkAccessChecks',
];
/** The machine may be busy. */
export const PATIENCE_MS = 240_000;

/** Starts `volery serve` on a fresh folder and a port of the system's choice; `api` asks it. */
export async function startServer(args = []) {
  const program = process.env.VOLERY_BIN;
  if (!program) throw new Error('VOLERY_BIN does not name the program volery');
  const data = await mkdtemp(path.join(tmpdir(), 'volery-page-'));
  const child = spawn(program, ['serve', '--data', data, '--listen', '127.0.0.1:0', ...args], {
    stdio: ['ignore', 'pipe', 'pipe'],
  });
  let said = '';
  const seen = { address: null, token: null };
  const ready = new Promise((resolve, reject) => {
    const read = (line) => {
      said += `${line}\n`;
      seen.address ??= /listens on (http:\S+)/.exec(line)?.[1] ?? null;
      seen.token ??= /\b(vly_[0-9a-f]+)\b/.exec(line)?.[1] ?? null;
      if (seen.address && seen.token) resolve();
    };
    createInterface(child.stdout).on('line', read);
    createInterface(child.stderr).on('line', read);
    child.on('exit', (code) => reject(new Error(`the server ended with ${code}:\n${said}`)));
  });
  await ready;
  const api = async (method, route, body, type = 'application/json') => {
    const answer = await fetch(seen.address + route, {
      method,
      headers: { authorization: `Bearer ${seen.token}`, ...(body && type && { 'content-type': type }) },
      body: type === 'application/json' && body ? JSON.stringify(body) : body,
    });
    const text = await answer.text();
    if (!answer.ok) throw new Error(`${method} ${route}: ${answer.status} ${text}`);
    return text && JSON.parse(text);
  };
  return {
    ...seen,
    api,
    said: () => said,
    async stop() {
      child.removeAllListeners('exit');
      const ended = new Promise((done) => child.once('exit', done));
      child.kill('SIGTERM');
      await ended;
      await rm(data, { recursive: true, force: true });
    },
  };
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

export async function startBrowser() {
  return chromium.launch({ executablePath: BROWSER, args: ARGS });
}

/**
 * A page that keeps what its console complained of. `VOLERY_PAGE` names a folder with a built page
 * that is opened instead of the one in the program.
 */
export async function openPage(browser, base, options = {}) {
  const context = await browser.newContext({
    baseURL: base, viewport: { width: 1280, height: 800 }, ...options,
  });
  context.setDefaultTimeout(PATIENCE_MS);
  const built = process.env.VOLERY_PAGE;
  if (built) await context.route((url) => url.origin === base && !/^\/(v1|openapi)/.test(url.pathname), (route) => {
    const name = path.join(built, new URL(route.request().url()).pathname);
    return route.fulfill({ path: path.extname(name) ? name : path.join(built, 'index.html') });
  });
  const page = await context.newPage();
  const complaints = [];
  page.on('console', (message) => {
    if (message.type() === 'error') complaints.push(message.text());
  });
  page.on('pageerror', (error) => complaints.push(String(error)));
  page.on('request', (request) => {
    const url = new URL(request.url());
    if (url.protocol.startsWith('http') && url.origin !== base) complaints.push(`went to ${url}`);
  });
  return { page, complaints };
}

/** Drops files (`{name, type, bytes}`) on an element, as a hand would. */
export async function dropFiles(page, selector, files) {
  const packed = files.map(({ name, type, bytes }) => ({
    name, type, base64: Buffer.from(bytes).toString('base64'),
  }));
  const transfer = await page.evaluateHandle((files) => {
    const transfer = new DataTransfer();
    for (const { name, type, base64 } of files) {
      const bytes = Uint8Array.from(atob(base64), (char) => char.charCodeAt(0));
      transfer.items.add(new File([bytes], name, { type }));
    }
    return transfer;
  }, packed);
  await page.dispatchEvent(selector, 'dragover', { dataTransfer: transfer });
  await page.dispatchEvent(selector, 'drop', { dataTransfer: transfer });
}

const shots = process.env.VOLERY_SHOTS;

/** Looks at a view in both themes: a picture of each, and what axe finds serious. */
export async function inspect(page, name) {
  const serious = [];
  await bringAxe(page);
  for (const theme of ['light', 'dark']) {
    await page.emulateMedia({ colorScheme: theme });
    await page.waitForFunction((theme) => document.documentElement.dataset.theme === theme, theme);
    if (shots) {
      await mkdir(shots, { recursive: true });
      await page.screenshot({ path: path.join(shots, `${name}-${theme}.png`) });
    }
    // Themes differ by colors alone.
    const options = theme === 'light' ? {} : { runOnly: ['color-contrast'] };
    const { violations } = await page.evaluate((options) => window.axe.run({ resultTypes: ['violations'], ...options }), options);
    for (const { id, impact, nodes } of violations) {
      if (impact !== 'serious' && impact !== 'critical') continue;
      serious.push(`${name}, ${theme}: ${id} at ${nodes.map(({ target }) => target).join(', ')}`);
    }
  }
  await page.emulateMedia({ colorScheme: 'light' });
  return serious;
}

const axe = readFile(require.resolve('axe-core/axe.min.js'), 'utf8');

/** Once for each document, past the content policy of the page, which lets no script in. */
async function bringAxe(page) {
  if (await page.evaluate(() => 'axe' in window)) return;
  const session = await page.context().newCDPSession(page);
  await session.send('Runtime.evaluate', { expression: await axe });
  await session.detach();
}

/**
 * Clicks from the middle of the scene, or from `beside` pixels right of it, outwards until `seen`; again
 * where a scene was not drawn in time.
 */
export async function clickAround(page, seen, step = 28, beside = 0) {
  const { x, y, width, height } = await page.locator('.scene canvas').boundingBox();
  const places = [];
  for (let i = -12; i <= 12; i++) {
    for (let k = -8; k <= 8; k++) places.push([i * step, k * step]);
  }
  places.sort(([a, b], [c, d]) => Math.hypot(a, b) - Math.hypot(c, d));
  const inside = places.filter(([dx, dy]) => Math.abs(dx + beside) < width / 2 - 10 && Math.abs(dy) < height / 2 - 70);
  for (const [dx, dy] of [...inside, ...inside]) {
    await page.mouse.click(x + width / 2 + beside + dx, y + height / 2 + dy);
    // The page answers with its next picture.
    await page.evaluate(() => new Promise(requestAnimationFrame));
    if (await seen()) return;
  }
  assert.fail('nothing was hit');
}
