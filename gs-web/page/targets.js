// Built-in pictures to fit, as RGBA bytes. They are computed, so that every browser has the same.

const WIDTH = 768;
const HEIGHT = 512;

export function builtInTarget(name) {
  const color = { shapes, rings, scene }[name] ?? scene;
  const pixels = new Uint8Array(4 * WIDTH * HEIGHT);
  for (let y = 0, at = 0; y < HEIGHT; y++) {
    for (let x = 0; x < WIDTH; x++) {
      for (const value of color(x + 0.5, y + 0.5)) pixels[at++] = Math.round(255 * Math.min(1, Math.max(0, value)));
      pixels[at++] = 255;
    }
  }
  return { pixels, width: WIDTH, height: HEIGHT };
}

function shapes(x, y) {
  if (Math.hypot(x - 250, y - 256) < 130) return [0.85, 0.2, 0.15];
  if (Math.abs(x - 540) < 110 && Math.abs(y - 256) < 110) return [0.1, 0.35, 0.8];
  return [1, 1, 1];
}

function rings(x, y) {
  const wave = 0.5 + 0.5 * Math.sin(Math.hypot(x - 384, y - 256) ** 1.5 / 90);
  return [wave, 0.5 * wave + 0.25, 1 - wave];
}

/** A sky, a hill with grass, water with waves: smooth parts, edges, and fine texture. */
function scene(x, y) {
  const hill = 250 + 60 * Math.sin(x / 130) + 18 * Math.sin(x / 37 + 1);
  const noise = value(x, y, 6) * 0.5 + value(x, y, 3) * 0.3 + value(x, y, 1.5) * 0.2;
  if (y < hill) {
    const cloud = Math.max(0, value(x, 1.8 * y, 60) + 0.4 * value(x, y, 20) - 0.75);
    const sun = Math.exp(-((x - 600) ** 2 + (y - 90) ** 2) / 1800);
    const sky = y / 400;
    return [0.35 + 0.35 * sky + cloud + sun, 0.55 + 0.25 * sky + 0.9 * cloud + 0.8 * sun, 0.9 + 0.3 * cloud - 0.3 * sun];
  }
  if (y < 390 + 8 * Math.sin(x / 60)) {
    const light = 0.7 + 0.3 * Math.sin((x - y) / 90);
    return [(0.2 + 0.35 * noise) * light, (0.35 + 0.4 * noise) * light, (0.1 + 0.15 * noise) * light];
  }
  const wave = 0.5 + 0.5 * Math.sin(y / 2.2 + 6 * value(x, y, 25));
  return [0.08 + 0.2 * wave * noise, 0.25 + 0.25 * wave, 0.4 + 0.35 * wave];
}

/** Smooth noise of this size, 0 to 1. */
function value(x, y, size) {
  const [u, v] = [x / size, y / size];
  const [i, j] = [Math.floor(u), Math.floor(v)];
  const ease = (t) => t * t * (3 - 2 * t);
  const [s, t] = [ease(u - i), ease(v - j)];
  const top = at(i, j) * (1 - s) + at(i + 1, j) * s;
  const bottom = at(i, j + 1) * (1 - s) + at(i + 1, j + 1) * s;
  return top * (1 - t) + bottom * t;
}

/** A number from 0 to 1 that belongs to a point of the grid. */
function at(i, j) {
  let hash = Math.imul(i, 0x27d4eb2d) ^ Math.imul(j, 0x165667b1);
  hash = Math.imul(hash ^ (hash >>> 15), 0x2c1b3c6d);
  hash = Math.imul(hash ^ (hash >>> 12), 0x297a2d39);
  return ((hash ^ (hash >>> 15)) >>> 0) / 4294967295;
}
