// Shows a streamed SOG in the viewer of the npm package, from a static server on this machine: the time until the
// first picture and the bytes before it, then pictures a second while a camera flies through, the longest time
// without a picture, and the memory of the browser's process.
//
// cargo xtask web --package --install
// node gs-web/benches/levels.mjs chromium target/web-package/tree gs target/web-test CITY_FOLDER [cpu|wgpu]
//   ['{"keys": [{"position": [0, 0, -4], "target": [0, 0, 0]}, ...], "up": [0, -1, 0], "maxGaussians": 300000}']

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import path from "node:path";
import { close, launch, pageFolder, place, report } from "../tests/browser.mjs";

const [folder, backend = "cpu", text = "{}"] = process.argv.slice(6);
const { keys, up, maxGaussians, seconds = 20 } = JSON.parse(text);
const [SIZE, FOLDERS] = [[640, 480], { "/viewer/": pageFolder, "/scene/": folder }];
const TYPES = { html: "text/html", js: "text/javascript", wasm: "application/wasm", json: "application/json" };
const HTML = `<!doctype html><link rel="icon" href="data:,"><div id="place" style="width: ${SIZE[0]}px; height: ${SIZE[1]}px"></div>`;

let bytes = 0;
/** Bytes that were sent before each chunk was asked for. */
const before = [];
const server = http.createServer(({ url }, response) => {
  const { pathname } = new URL(url, "http://localhost");
  const under = Object.keys(FOLDERS).find((under) => pathname.startsWith(under));
  const file = under && path.join(FOLDERS[under], pathname.slice(under.length));
  if (under && !fs.existsSync(file)) return response.writeHead(404).end();
  const content = under ? fs.readFileSync(file) : Buffer.from(HTML);
  response.writeHead(200, { "content-type": under ? (TYPES[path.extname(file).slice(1)] ?? "application/octet-stream") : "text/html" });
  if (pathname.endsWith("/meta.json")) before.push(bytes);
  bytes += content.length;
  response.end(content);
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));

const browser = await launch("--enable-unsafe-webgpu");
const page = await browser.newPage();
page.on("console", (message) => report("console:", message.text()));
page.on("pageerror", (error) => report("error:", error.message));
await page.goto(`http://localhost:${server.address().port}/`);
bytes = 0;

/** Proportional set size of the browser's process with the page, MB. */
function memory() {
  const processes = execFileSync("pgrep", ["-f", "type=renderer"], { encoding: "utf8" }).trim().split("\n");
  const sizes = processes.map((id) => {
    try {
      return Number(/^Pss:\s+(\d+)/m.exec(fs.readFileSync(`/proc/${id}/smaps_rollup`, "utf8"))[1]);
    } catch {
      return 0;
    }
  });
  return Math.max(...sizes) / 1024;
}

const first = await page.evaluate(async (backend, maxGaussians) => {
  const started = performance.now();
  const { Viewer } = await import("/viewer/viewer.js");
  globalThis.pictures = [];
  let seen;
  const shown = new Promise((resolve) => (seen = resolve));
  const ondraw = (picture) => {
    pictures.push({ at: performance.now(), ...picture });
    seen();
  };
  globalThis.viewer = new Viewer(document.getElementById("place"), { backend, maxGaussians, ondraw, onerror: ({ message }) => console.log(message) });
  await viewer.load("/scene/lod-meta.json");
  await shown;
  return { after: performance.now() - started, info: viewer.info, ...pictures[0] };
}, backend, maxGaussians);
const megabytes = (bytes) => `${(bytes / 1e6).toFixed(2)} MB`;
// The second chunk is not asked for before the first one is there.
report(`first picture after ${first.after.toFixed(0)} ms and ${megabytes(before[1] ?? bytes)}: ${first.gaussians} of ${first.info.gaussians} Gaussians, drawn in ${first.took.toFixed(0)} ms`);
report(`home: ${JSON.stringify(first.info.home)}`);

const complete = () => page.waitForFunction(() => pictures.at(-1).complete, { timeout: 120_000, polling: 100 });
await complete();
const settled = await page.evaluate(() => [performance.now() - pictures[0].at, pictures.at(-1)]);
report(`complete ${settled[0].toFixed(0)} ms later, ${megabytes(bytes)}: ${settled[1].gaussians} Gaussians in ${settled[1].took.toFixed(0)} ms; memory ${memory().toFixed(0)} MB`);
await page.screenshot({ path: path.join(place, "levels-first.png") });

// A flight along the keys, or once around the first camera's target.
const flight = await page.evaluate(async (keys, up, seconds) => {
  const { position, target } = viewer.info.home;
  const away = position.map((x, k) => x - target[k]);
  const around = (t) => {
    const [c, s] = [Math.cos(2 * Math.PI * t), Math.sin(2 * Math.PI * t)];
    return { position: [target[0] + c * away[0] + s * away[2], position[1], target[2] - s * away[0] + c * away[2]], target };
  };
  const along = (t) => {
    const at = t * (keys.length - 1);
    const k = Math.min(Math.floor(at), keys.length - 2);
    const mix = (name) => keys[k][name].map((x, axis) => x + (at - k) * (keys[k + 1][name][axis] - x));
    return { position: mix("position"), target: mix("target") };
  };
  const before = pictures.length;
  const started = performance.now();
  await new Promise((resolve) => {
    const move = () => {
      const t = (performance.now() - started) / (1000 * seconds);
      if (t >= 1) return resolve();
      viewer.camera = { ...(keys ? along(t) : around(t)), ...(up && { up }) };
      requestAnimationFrame(move);
    };
    move();
  });
  const drawn = pictures.slice(before);
  const between = drawn.slice(1).map(({ at }, k) => at - drawn[k].at);
  between.sort((a, b) => a - b);
  const sizes = drawn.map(({ width }) => width).sort((a, b) => a - b);
  return { number: drawn.length, longest: between.slice(-3), median: between[between.length >> 1], width: sizes[sizes.length >> 1], most: Math.max(...drawn.map(({ gaussians }) => gaussians)) };
}, keys, up, seconds);
report(`flight of ${seconds} s: ${(flight.number / seconds).toFixed(1)} pictures a second, median width ${flight.width} px, between two ${flight.median.toFixed(0)} ms, at longest ${flight.longest.map((ms) => ms.toFixed(0)).join(", ")} ms; up to ${flight.most} Gaussians`);
await complete();
report(`at the end ${megabytes(bytes)}, memory ${memory().toFixed(0)} MB`);
await page.screenshot({ path: path.join(place, "levels-last.png") });
await browser.close();
server.close();
await close();
