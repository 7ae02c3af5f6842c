// Photos of a painted room that does not exist: drawn by three.js in the browser.
import { readFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import path from 'node:path';

const require = createRequire(import.meta.url);
const THREE = path.dirname(require.resolve('three'));

export const WIDTH = 480;
export const HEIGHT = 360;
const FOCAL = 360;

export const CAMERA = {
  model: 'PINHOLE', width: WIDTH, height: HEIGHT, params: [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2],
};

/** Where the camera stands and what it looks at: `count` views along an arc; z up, meters. */
function viewsAlongArc(count) {
  return Array.from({ length: count }, (_, i) => {
    const part = i / (count - 1) - 0.5;
    return {
      position: [-1.7 + 0.4 * Math.cos(6 * part), 1.8 * part, 1.3 + 0.7 * Math.sin(9 * part)],
      target: [1.4, 0.35 * part, 0.95],
    };
  });
}

/** `count` PNG photos along an arc, looking at one corner of the room, and where they were taken. */
export async function photographRoom(browser, count) {
  const views = viewsAlongArc(count);
  const page = await browser.newPage();
  await page.route('http://room.test/**', async (route) => {
    const name = new URL(route.request().url()).pathname.slice(1);
    if (name === '') return route.fulfill({ contentType: 'text/html', body: '<!doctype html>' });
    const body = await readFile(path.join(THREE, path.basename(name)));
    return route.fulfill({ contentType: 'text/javascript', body });
  });
  await page.goto('http://room.test/');
  const pictures = await page.evaluate(draw, { views, width: WIDTH, height: HEIGHT, focal: FOCAL });
  await page.close();
  return pictures.map((base64, index) => ({
    name: `room_${String(index).padStart(2, '0')}.png`,
    type: 'image/png',
    bytes: Buffer.from(base64, 'base64'),
    ...views[index],
  }));
}

/** Runs in the page. */
async function draw({ views, width, height, focal }) {
  const three = await import('http://room.test/three.module.js');
  let state = 7;
  const random = () => {
    // mulberry32
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  const paint = () => {
    const canvas = new OffscreenCanvas(1024, 1024);
    const context = canvas.getContext('2d');
    context.fillStyle = `hsl(${random() * 360} 25% 60%)`;
    context.fillRect(0, 0, 1024, 1024);
    for (let i = 0; i < 900; i++) {
      const size = 8 + 90 * random() ** 3;
      context.fillStyle = `hsl(${random() * 360} ${30 + random() * 60}% ${15 + random() * 70}%)`;
      context.save();
      context.translate(random() * 1024, random() * 1024);
      context.rotate(random() * 6.3);
      context.fillRect(-size / 2, -size / 3, size, size * (0.3 + random()));
      context.restore();
    }
    const texture = new three.CanvasTexture(canvas);
    texture.colorSpace = three.SRGBColorSpace;
    texture.anisotropy = 8;
    return new three.MeshBasicMaterial({ map: texture, side: three.BackSide });
  };
  const scene = new three.Scene();
  const room = new three.Mesh(new three.BoxGeometry(5, 4, 2.6), Array.from({ length: 6 }, paint));
  room.position.z = 1.3;
  scene.add(room);
  for (const [x, y, side] of [[1.5, 0.6, 0.7], [1.1, -0.9, 0.5], [0.4, 1.2, 0.4]]) {
    const box = new three.Mesh(new three.BoxGeometry(side, side, side), Array.from({ length: 6 }, paint));
    for (const material of box.material) material.side = three.FrontSide;
    box.position.set(x, y, side / 2);
    scene.add(box);
  }
  const renderer = new three.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.setSize(width, height);
  const fov = (2 * Math.atan(height / 2 / focal) * 180) / Math.PI;
  const camera = new three.PerspectiveCamera(fov, width / height, 0.05, 20);
  camera.up.set(0, 0, 1);
  const pictures = [];
  for (const { position, target } of views) {
    camera.position.set(...position);
    camera.lookAt(...target);
    renderer.render(scene, camera);
    const blob = await new Promise((done) => renderer.domElement.toBlob(done, 'image/png'));
    const bytes = new Uint8Array(await blob.arrayBuffer());
    let text = '';
    for (const byte of bytes) text += String.fromCharCode(byte);
    pictures.push(btoa(text));
  }
  renderer.dispose();
  return pictures;
}
