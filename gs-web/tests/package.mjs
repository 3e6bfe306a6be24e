// Tests the npm package as its users have it: installed from its archive, typed, and in headless Chromium on a
// static host without special headers.
//
// node package.mjs BROWSER ARCHIVE GS PLACE TOOLS [NAME]: the browser, the archive, the program, a folder with
// puppeteer-core where files and screenshots are kept, and a folder with TypeScript. With NAME, a regular expression,
// only the tests whose name matches it.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { at, close, launch, makeScene, place, psnr, report, run } from "./browser.mjs";
import { picture } from "./fit.mjs";

const [archive, tools] = [process.argv[3], process.argv[6]].map((name) => path.resolve(name));
const site = at("site");
fs.mkdirSync(site);
const inSite = (name) => path.join(site, name);

const IMPORTS = { imports: { "gaussian-splats": "/node_modules/gaussian-splats/viewer.js", "gaussian-splats/gsi": "/node_modules/gaussian-splats/gsi.js" } };
const HTML = (body) => `<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<link rel="icon" href="data:,">
<script type="importmap">${JSON.stringify(IMPORTS)}</script>
<script type="module">import * as api from "gaussian-splats"; import * as gsi from "gaussian-splats/gsi"; Object.assign(globalThis, { api, gsi });</script>
<body style="font-family: sans-serif">${body}`;

fs.writeFileSync(inSite("package.json"), '{ "private": true, "type": "module" }');
execFileSync("npm", ["install", "--ignore-scripts", "--no-audit", "--no-fund", "--offline", archive], { cwd: site, stdio: "pipe" });
makeScene(at("made.ply"));
run("convert", at("made.ply"), inSite("scene.sog"));
run("convert", at("made.ply"), inSite("second.splat"));
run("render", inSite("scene.sog"), "-o", at("scene.png"), "--backend", "cpu", "--size", "256x256");
run("render", inSite("scene.sog"), "-o", inSite("poster.png"), "--backend", "cpu", "--size", "60x40");
fs.writeFileSync(inSite("broken.sog"), fs.readFileSync(inSite("scene.sog")).subarray(0, 400));
fs.writeFileSync(inSite("fallback.png"), picture(48, 32));
run("encode", inSite("fallback.png"), "-o", inSite("photo.gsi"), "--quality", "60");
run("decode", inSite("photo.gsi"), "-o", at("photo.png"), "--backend", "cpu");
fs.writeFileSync(inSite("broken.gsi"), fs.readFileSync(inSite("photo.gsi")).subarray(0, 60));
const body = (more) => `
  <gs-viewer ${more} src="scene.sog" poster="poster.png" alt="Blobs" background="white">This scene can't be shown.</gs-viewer>
  <p>Text below the scene.</p>
  <gsi-img src="photo.gsi" fallback="fallback.png" alt="Patches" style="width: 240px; aspect-ratio: 3 / 2"></gsi-img>`;
fs.writeFileSync(inSite("index.html"), HTML(body("")));
fs.writeFileSync(inSite("wgpu.html"), HTML(body('backend="wgpu"')));

const TYPES = { html: "text/html", js: "text/javascript", wasm: "application/wasm", png: "image/png" };
/** Files that the server pretends not to have. */
const withheld = new Set();
const server = http.createServer(({ url }, response) => {
  const { pathname } = new URL(url, "http://localhost");
  const file = inSite(pathname === "/" ? "index.html" : pathname);
  if (!fs.existsSync(file) || withheld.has(path.basename(file))) return response.writeHead(404).end("no");
  response.writeHead(200, { "content-type": TYPES[path.extname(file).slice(1)] ?? "application/octet-stream" }).end(fs.readFileSync(file));
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));
const home = `http://localhost:${server.address().port}/`;

/** The page, once its viewer has shown its scene or an error. */
async function opened(browser, name = "") {
  const page = await browser.newPage();
  const complaints = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("request", (request) => {
    const url = request.url();
    if (!url.startsWith(home) && !url.startsWith("blob:") && !url.startsWith("data:")) complaints.push(`asked for ${url}`);
  });
  await page.setViewport({ width: 1000, height: 900 });
  await page.evaluateOnNewDocument(() => {
    globalThis.told = [];
    for (const name of ["load", "progress", "error"]) {
      document.addEventListener(name, (event) => {
        const { target, detail } = event;
        if (detail) told.push([target.localName, name, detail.message ?? detail.gaussians ?? detail.width ?? detail.loaded]);
      }, true);
    }
  });
  await page.goto(home + name);
  await told(page, "gs-viewer");
  await told(page, "gsi-img");
  const failures = await page.evaluate(() => told.filter(([, event]) => event === "error"));
  assert.equal(failures.length, withheld.size > 0 ? 2 : 0, JSON.stringify(failures));
  return { page, complaints };
}

/** Waits until an element has told that it shows something, or why not. */
const told = (page, name, after = 0) =>
  page.waitForFunction((name, after) => told.slice(after).some(([of, event]) => of === name && event !== "progress"), { timeout: 60_000 }, name, after);

/** Sets an attribute of the viewer, and returns what it tells. */
async function set(page, element, attribute, value) {
  const before = await page.evaluate(() => told.length);
  await page.$eval(element, (of, attribute, value) => of.setAttribute(attribute, value), attribute, value);
  await told(page, element, before);
  return page.evaluate((before) => told.slice(before).filter(([, event]) => event !== "progress"), before);
}

/** What the viewer draws at this size, as RGBA. */
async function snapshot(page, size) {
  const bytes = await page.$eval("gs-viewer", async ({ viewer }, size) => {
    const bitmap = await createImageBitmap(await viewer.snapshot(size));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return [...context.getImageData(0, 0, bitmap.width, bitmap.height).data];
  }, size);
  return Buffer.from(bytes);
}

const tests = {
  "the types are those of the documentation"() {
    fs.writeFileSync(inSite("usage.ts"), `
import { Viewer, type SceneInfo } from "gaussian-splats";
import { decode } from "gaussian-splats/gsi";
const viewer = new Viewer(document.body, { backend: "cpu", background: [1, 1, 1], ondraw: ({ took }) => took.toFixed() });
const info: SceneInfo = await viewer.load("scene.sog", { progress: ({ loaded, total }) => loaded / (total ?? 1) });
viewer.camera = { fov: 50 };
const [x, y, z]: number[] = viewer.camera.position;
const image = await decode(await fetch("a.gsi"), { partial: true });
document.createElement("gs-viewer").src = String(info.gaussians + image.width + x! + y! + z!);
// @ts-expect-error
await viewer.load(3);
`);
    const tsc = path.join(tools, "node_modules/typescript/bin/tsc");
    execFileSync(process.execPath, [tsc, "--noEmit", "--strict", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom,dom.iterable", "usage.ts"], { cwd: site, encoding: "utf8", stdio: "pipe" });
  },

  async "without WebGPU, a scene is drawn as the program draws it"() {
    const browser = await launch();
    const { page, complaints } = await opened(browser);
    assert.deepEqual(await page.$eval("gs-viewer", ({ viewer }) => [viewer.engine.backend, viewer.info.gaussians]), ["cpu", 400]);
    await page.$eval("gs-viewer", ({ viewer }) => (viewer.background = undefined));
    const found = psnr(await snapshot(page, [256, 256]), fs.readFileSync(at("scene.png")));
    report("dB against gs render", found);
    assert.ok(found > 50, `${found} dB`);
    await page.$eval("gs-viewer", ({ viewer }) => (viewer.background = [1, 1, 1]));
    for (const width of [1000, 400]) {
      await page.setViewport({ width, height: 900 });
      await new Promise((resolve) => setTimeout(resolve, 500));
      await page.screenshot({ path: path.join(place, `package-${width}.png`) });
      const [outer, inner] = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
      assert.equal(outer, inner, `scrolls sideways at ${width} px`);
    }
    assert.deepEqual(complaints, []);
    await browser.close();
  },

  async "with WebGPU, it computes"() {
    const browser = await launch("--enable-unsafe-webgpu");
    const { page, complaints } = await opened(browser, "wgpu.html");
    assert.equal(await page.$eval("gs-viewer", ({ viewer }) => viewer.engine.backend), "wgpu");
    await page.$eval("gs-viewer", ({ viewer }) => (viewer.background = undefined));
    const found = psnr(await snapshot(page, [256, 256]), fs.readFileSync(at("scene.png")));
    report("dB against gs render", found);
    assert.ok(found > 50, `${found} dB`);
    assert.deepEqual(complaints, []);
    await browser.close();
  },

  async "keys, attributes and other scenes change what is shown"() {
    const browser = await launch();
    const { page } = await opened(browser);
    const position = () => page.$eval("gs-viewer", ({ viewer }) => viewer.camera.position);
    const first = await position();
    const before = await snapshot(page, [64, 48]);
    await page.$eval("gs-viewer", (element) => element.shadowRoot.querySelector("canvas").focus());
    await page.keyboard.press("ArrowRight");
    assert.notDeepEqual(await position(), first);
    assert.ok(!before.equals(await snapshot(page, [64, 48])));
    await page.keyboard.press("Home");
    assert.deepEqual(await position(), first);
    await page.$eval("gs-viewer", (element) => element.setAttribute("camera", "0 0 -9, 0 0 0"));
    assert.deepEqual((await position()).map(Math.round), [0, 0, -9]);
    await page.$eval("gs-viewer", (element) => element.removeAttribute("camera"));
    assert.deepEqual(await set(page, "gs-viewer", "src", "second.splat"), [["gs-viewer", "load", 400]]);
    await page.$eval("gs-viewer", (element) => element.removeAttribute("src"));
    await page.waitForFunction(() => !document.querySelector("gs-viewer").shadowRoot.querySelector("canvas"));
    assert.deepEqual(await set(page, "gs-viewer", "src", "scene.sog"), [["gs-viewer", "load", 400]]);
    await page.$eval("gs-viewer", (element) => element.remove());
    await page.waitForFunction(() => document.querySelector("gs-viewer") === null);
    await browser.close();
  },

  async "files that are damaged or absent leave what is inside the element"() {
    const browser = await launch();
    const { page } = await opened(browser);
    const shown = () => page.$eval("gs-viewer", (element) => !element.shadowRoot.querySelector("slot").hidden);
    assert.equal(await shown(), false);
    for (const [name, expected] of [["broken.sog", /truncated|damaged|ends|not a|SOG/i], ["absent.sog", /absent\.sog: the server answers 404/]]) {
      const [[, event, message]] = await set(page, "gs-viewer", "src", name);
      report(name, message);
      assert.equal(event, "error");
      assert.match(message, expected);
      assert.equal(await shown(), true);
    }
    assert.deepEqual(await set(page, "gs-viewer", "src", "scene.sog"), [["gs-viewer", "load", 400]]);
    assert.equal(await shown(), false);
    for (const name of ["broken.gsi", "absent.gsi"]) {
      const [[, event, message]] = await set(page, "gsi-img", "src", name);
      report(name, message);
      assert.equal(event, "error");
      assert.equal(await page.$eval("gsi-img", (element) => element.shadowRoot.querySelector("img").getAttribute("src")), "fallback.png");
    }
    assert.deepEqual(await set(page, "gsi-img", "src", "photo.gsi"), [["gsi-img", "load", 48]]);
    await browser.close();
  },

  async "what can't be had at first is shown when it can"() {
    const browser = await launch();
    for (const name of ["scene.sog", "gsi-worker.js"]) withheld.add(name);
    const { page } = await opened(browser);
    withheld.clear();
    const inside = () => page.$eval("gs-viewer", ({ shadowRoot: root }) => [root.querySelector("slot").hidden, root.getElementById("poster") === null]);
    assert.deepEqual(await inside(), [false, true], "the content of the element, and no poster over it");
    assert.deepEqual(await set(page, "gs-viewer", "src", "scene.sog?again"), [["gs-viewer", "load", 400]]);
    assert.deepEqual(await set(page, "gsi-img", "src", "photo.gsi?again"), [["gsi-img", "load", 48]]);
    await browser.close();
  },

  async "an image is decoded as the program decodes it, in the browser and in Node"() {
    const { decode } = await import(pathToFileURL(inSite("node_modules/gaussian-splats/gsi.js")));
    await import(pathToFileURL(inSite("node_modules/gaussian-splats/viewer.js")));
    const bytes = fs.readFileSync(inSite("photo.gsi"));
    const { width, height, data } = await decode(bytes);
    assert.deepEqual([width, height], [48, 32]);
    const found = psnr(data, fs.readFileSync(at("photo.png")));
    report("Node: dB against gs decode", found);
    assert.ok(found > 50, `${found} dB`);
    await assert.rejects(decode(bytes.subarray(0, 60)), /truncated|ends|damaged/i);
    await assert.rejects(decode(Buffer.from("no picture")), Error);
    assert.equal((await decode(bytes.subarray(0, bytes.length - 9), { partial: true })).width, 48);
    const browser = await launch();
    const { page, complaints } = await opened(browser);
    const pixels = await page.evaluate(async () => [...(await gsi.decode(await fetch("photo.gsi"))).data]);
    assert.deepEqual(Buffer.from(pixels), Buffer.from(data));
    assert.deepEqual(complaints, []);
    await browser.close();
  },

  async "colours of a profile are converted as the browser converts those of a PNG"() {
    const { png } = await import(pathToFileURL(inSite("node_modules/gaussian-splats/png.js")));
    const { decode } = await import(pathToFileURL(inSite("node_modules/gaussian-splats/gsi.js")));
    const green = new Uint8Array(4 * 48 * 32).map((_, k) => [40, 200, 60, 255][k % 4]);
    fs.writeFileSync(at("wide.png"), Buffer.from(await (await png(48, 32, green, displayP3())).arrayBuffer()));
    run("encode", at("wide.png"), "-o", inSite("wide.gsi"), "--quality", "60");
    run("decode", inSite("wide.gsi"), "-o", inSite("wide.png"), "--backend", "cpu");
    const { profile } = await decode(fs.readFileSync(inSite("wide.gsi")));
    assert.ok(profile.length > 300, "Node gives the profile");
    const browser = await launch();
    const { page } = await opened(browser);
    const [own, other] = await page.evaluate(async () => {
      const own = await gsi.decode(await fetch("wide.gsi"));
      const bitmap = await createImageBitmap(await (await fetch("wide.png")).blob());
      const context = new OffscreenCanvas(48, 32).getContext("2d");
      context.drawImage(bitmap, 0, 0);
      return [own.data, context.getImageData(0, 0, 48, 32).data].map((data) => [...data.slice(0, 4)]);
    });
    report("sRGB", own.join(" "), "by a PNG", other.join(" "));
    assert.ok(own.every((value, k) => Math.abs(value - other[k]) <= 1), `${own}, ${other}`);
    assert.ok(own[0] < 20, "P3 green has less red in sRGB");
    await browser.close();
  },
};

/** An ICC profile with the primaries of Display P3 and a gamma of 2.2. */
function displayP3() {
  const fixed = (value) => {
    const bytes = Buffer.alloc(4);
    bytes.writeInt32BE(Math.round(65536 * value));
    return bytes;
  };
  const xyz = (...values) => Buffer.concat([Buffer.from("XYZ \0\0\0\0", "latin1"), ...values.map(fixed)]);
  const curve = Buffer.from("curv\0\0\0\0\0\0\0\x01\x02\x33\0\0", "latin1");
  const tags = Object.entries({
    wtpt: xyz(0.9642, 1, 0.8249), rXYZ: xyz(0.5151, 0.2412, -0.0011), gXYZ: xyz(0.292, 0.6922, 0.0419), bXYZ: xyz(0.1571, 0.0666, 0.7841),
    rTRC: curve, gTRC: curve, bTRC: curve,
  });
  const table = Buffer.alloc(4 + 12 * tags.length);
  table.writeUInt32BE(tags.length, 0);
  let place = 128 + table.length;
  tags.forEach(([name, { length }], k) => {
    table.write(name, 4 + 12 * k, "latin1");
    table.writeUInt32BE(place, 8 + 12 * k);
    table.writeUInt32BE(length, 12 + 12 * k);
    place += length;
  });
  const header = Buffer.alloc(128);
  header.writeUInt32BE(place, 0);
  header.set([2, 0x40], 8);
  header.write("mntrRGB XYZ ", 12, "latin1");
  header.write("acsp", 36, "latin1");
  Buffer.concat([0.9642, 1, 0.8249].map(fixed)).copy(header, 68);
  return Buffer.concat([header, table, ...tags.map(([, content]) => content)]);
}

let failed = 0;
const only = new RegExp(process.argv[7] ?? "");
for (const [name, test] of Object.entries(tests).filter(([name]) => only.test(name))) {
  const started = Date.now();
  try {
    await test();
    console.log(`ok ${name} (${((Date.now() - started) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed += 1;
    console.log(`FAILED ${name}\n${error.stdout ?? ""}${error.stack}`);
  }
}
server.close();
await close();
console.log(failed === 0 ? "all tests passed" : `${failed} failed`);
// Browsers of tests that failed are still open.
process.exit(failed === 0 ? 0 : 1);
