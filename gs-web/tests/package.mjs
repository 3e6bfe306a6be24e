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
import { gzipSync } from "node:zlib";
import { at, close, launch, makeScene, place, psnr, report, run } from "./browser.mjs";
import { picture } from "./fit.mjs";
import { runTests } from "./runner.mjs";

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
const rows = fs.readFileSync(at("made.ply"), "utf8").trim().split("\n");
fs.writeFileSync(inSite("half.ply"), rows.slice(0, -200).join("\n").replace("vertex 400", "vertex 200"));
run("render", inSite("scene.sog"), "-o", at("scene.png"), "--backend", "cpu", "--size", "256x256");
run("render", inSite("scene.sog"), "-o", inSite("poster.png"), "--backend", "cpu", "--size", "60x40");
makeScene(at("city.ply"), 9000);
run("convert", at("city.ply"), inSite("city/lod-meta.json"));
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
fs.writeFileSync(inSite("place.html"), HTML('<div id="place" style="width: 300px; height: 200px"></div>'));

const TYPES = { html: "text/html", js: "text/javascript", wasm: "application/wasm", png: "image/png" };
/** Files that the server pretends not to have. */
const withheld = new Set();
/** Files that the server changes: what is put into their text, and after which part of it. */
const changed = new Map();
/** What the server was asked for, since a test has emptied it, and the folders of it all. */
const asked = [];
const askedIn = [];
/** The folders of chunks that the server was asked for, of the last scene with levels of detail. */
const levelsAsked = () => askedIn.slice(askedIn.lastIndexOf("city") + 1).filter((name) => /^\d_\d$/.test(name));
/** The query of the last `lod-meta.json`. After `?slow`, chunks are never sent; after `?key=7`, only with this query. */
let query = "";
const server = http.createServer(({ url }, response) => {
  const { pathname, search } = new URL(url, "http://localhost");
  const file = inSite(pathname === "/" ? "index.html" : pathname);
  asked.push(path.basename(file));
  askedIn.push(path.basename(path.dirname(file)));
  if (file.endsWith("lod-meta.json")) query = search;
  else if (/^\d_\d$/.test(path.basename(path.dirname(file)))) {
    if (query === "?slow") return;
    if (query === "?key=7" && search !== query) return response.writeHead(403).end("no key");
  }
  if (!fs.existsSync(file) || withheld.has(path.basename(file))) return response.writeHead(404).end("no");
  response.writeHead(200, { "content-type": TYPES[path.extname(file).slice(1)] ?? "application/octet-stream" }).end(contents(file));
});
function contents(file) {
  const insertions = changed.get(path.basename(file));
  if (!insertions) return fs.readFileSync(file);
  let text = fs.readFileSync(file, "utf8");
  for (const [after, inserted] of Object.entries(insertions)) {
    assert.ok(text.includes(after), `${file} has no ${after}`);
    text = text.replace(after, `${after}\n${inserted}`);
  }
  return text;
}
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

// What stops an engine: from then on, each use of its WebAssembly throws, as after a panic.
const STOP = 'wasm = new Proxy({}, { get() { throw new WebAssembly.RuntimeError("unreachable"); } });';
// A scene's name says what goes wrong with it.
const FAULTS = {
  "view(bytes, name) {": `globalThis.fault = name;
    if (name.includes("slow")) for (const end = performance.now() + 500; performance.now() < end; );
    if (name.endsWith("stops")) ${STOP}`,
  "Object.create(View.prototype);": "obj.fault = globalThis.fault;",
  "pixels(frame) {": `if (this.fault === "slow picture") for (const end = performance.now() + 1000; performance.now() < end; );
    if (this.fault.endsWith("has no picture")) throw new Error("no picture of this");
    if (this.fault === "stops in a picture" || JSON.parse(frame).width === 77) ${STOP}
    if (this.fault === "stops in a task") {
      setTimeout(() => { throw new WebAssembly.RuntimeError("unreachable"); });
      return new Promise(() => {});
    }`,
};

/**
 * A page with an empty viewer, `open(scene, name)`, which opens a scene of the site and gives what comes of it, and
 * `shown()`, which gives the Gaussians of what is open and a number for its picture.
 */
async function placed(browser, options = {}) {
  const page = await browser.newPage();
  const [workers, complaints] = [[], []];
  page.on("workercreated", (worker) => workers.push(worker.url()));
  page.on("pageerror", (error) => complaints.push(error.message));
  await page.goto(`${home}place.html`);
  await page.waitForFunction("globalThis.api");
  await page.evaluate(async (options) => {
    globalThis.errors = [];
    const onerror = ({ message }) => errors.push(message);
    const ondraw = (picture) => globalThis.ondrawn?.(picture);
    globalThis.viewer = new api.Viewer(document.getElementById("place"), { ...options, onerror, ondraw });
    const files = {};
    for (const name of ["scene.sog", "half.ply", "broken.sog"]) files[name] = await (await fetch(name)).arrayBuffer();
    globalThis.open = (scene, name = scene, more = {}) =>
      viewer.load(files[scene], { name, ...more }).then(({ gaussians }) => gaussians, ({ name, message }) => `${name}: ${message}`);
    globalThis.shown = async () => {
      const bitmap = await createImageBitmap(await viewer.snapshot([90, 60]));
      const context = new OffscreenCanvas(90, 60).getContext("2d");
      context.drawImage(bitmap, 0, 0);
      const { data } = context.getImageData(0, 0, 90, 60);
      return [viewer.info.gaussians, data.reduce((hash, byte) => (Math.imul(hash, 31) + byte) | 0, 0)];
    };
  }, options);
  const open = (...words) => page.evaluate((...words) => globalThis.open(...words), ...words);
  return { page, open, workers, complaints, shown: () => page.evaluate(() => globalThis.shown()) };
}

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

  async "a scene whose first picture fails is refused, and the one before stays open"() {
    changed.set("gs_viewer.js", FAULTS);
    const browser = await launch();
    const { page, open, workers, shown } = await placed(browser);
    assert.equal(await open("half.ply", "has no picture"), "Error: no picture of this");
    assert.equal(await page.evaluate(() => viewer.info), undefined);
    assert.equal(await open("scene.sog"), 400);
    await page.evaluate(() => (viewer.camera = { fov: 70 }));
    const before = await shown();
    assert.equal(await open("half.ply", "has no picture"), "Error: no picture of this");
    assert.deepEqual(await shown(), before);
    assert.equal(await open("half.ply"), 200);
    assert.equal(workers.length, 1);
    changed.clear();
    await browser.close();
  },

  async "after the engine has stopped, another one shows what was open"() {
    changed.set("gs_viewer.js", FAULTS);
    const browser = await launch();
    for (const name of ["stops", "stops in a picture", "stops in a task"]) {
      const { page, open, workers, complaints, shown } = await placed(browser);
      assert.match(await open("half.ply", name), /^Error: .*unreachable/, name);
      assert.equal(await open("scene.sog"), 400, name);
      await page.evaluate(() => (viewer.camera = { fov: 70 }));
      const before = await shown();
      const count = workers.length;
      const refused = await open("half.ply", name);
      report(name, refused);
      assert.match(refused, /^Error: .*unreachable/);
      assert.deepEqual(await shown(), before, name);
      assert.equal(workers.length, count + 2, "one that tries again, and one for what was open");
      assert.equal(await open("half.ply"), 200, name);
      assert.deepEqual([...complaints, ...(await page.evaluate(() => errors))], [], name);
      await page.close();
    }
    const { page, open, workers, shown } = await placed(browser);
    await open("scene.sog");
    const before = await shown();
    const seen = async () => (await page.$("#place")).screenshot();
    const picture = await seen();
    assert.match(await page.evaluate(() => viewer.snapshot([77, 50]).catch(({ message }) => message)), /unreachable/);
    assert.deepEqual(await seen(), picture, "the canvas keeps its picture");
    assert.deepEqual(await shown(), before);
    assert.equal(workers.length, 3);
    await page.evaluate(() => viewer.reset());
    await page.waitForFunction(() => viewer.engine);
    assert.deepEqual(await seen(), picture, "another canvas has the same one");
    changed.clear();
    await browser.close();
  },

  async "an open scene with which each engine stops is closed, and another one can be opened"() {
    changed.set("gs_viewer.js", FAULTS);
    const browser = await launch();
    const { page, open, workers, complaints, shown } = await placed(browser);
    await open("scene.sog");
    await page.$eval("#place", (element) => (element.style.width = "77px"));
    await page.waitForFunction(() => errors.length > 0);
    // Time for more, if it goes on.
    await new Promise((resolve) => setTimeout(resolve, 1000));
    assert.match((await page.evaluate(() => errors)).join(), /^[^,]*unreachable$/);
    assert.equal(workers.length, 2);
    assert.equal(await page.evaluate(() => viewer.info), undefined);
    await page.$eval("#place", (element) => (element.style.width = "80px"));
    assert.equal(await open("half.ply"), 200);
    assert.equal((await shown())[0], 200);
    assert.equal(await page.$$eval("canvas", (all) => all.length), 1);
    assert.deepEqual(complaints, []);
    changed.clear();
    await browser.close();
  },

  async "an engine that stops while it is opened leaves it to the CPU, or to the next scene"() {
    const browser = await launch();
    for (const [condition, first] of [['wanted !== "cpu"', 400], ["true", "Error: the engine stopped: unreachable"]]) {
      changed.set("gs_viewer.js", { "static open(wanted) {": `if (${condition}) ${STOP}` });
      const { page, open } = await placed(browser);
      assert.equal(await open("scene.sog"), first);
      changed.clear();
      assert.equal(await open("half.ply"), 200);
      assert.equal(await page.evaluate(() => viewer.engine.backend), "cpu");
      await page.close();
    }
    await browser.close();
  },

  async "of several scenes the last one counts, whatever the others end with"() {
    changed.set("gs_viewer.js", FAULTS);
    const browser = await launch();
    const { page, open, complaints, shown } = await placed(browser);
    /** Opens two scenes, the second one while the engine is busy with the first one. */
    const both = (first, second) => page.evaluate(async (first, second) => {
      const opening = open(...first);
      await new Promise((resolve) => setTimeout(resolve, 200));
      return Promise.all([opening, open(...second)]);
    }, first, second);
    const abandoned = /^AbortError: /;
    assert.equal(await open("scene.sog"), 400);
    const before = await shown();
    for (const first of [["half.ply", "slow"], ["half.ply", "slow picture"], ["half.ply", "slow, has no picture"], ["half.ply", "slow, stops"], ["broken.sog", "slow"]]) {
      for (const [second, expected] of [["broken.sog", /^Error: /], ["scene.sog", /^400$/]]) {
        const found = await both(first, [second]);
        assert.match(found[0], abandoned, `${first} ${second}`);
        assert.match(String(found[1]), expected, `${first} ${second}`);
        assert.deepEqual(await shown(), before, `${first} ${second}`);
      }
    }
    assert.deepEqual(await page.evaluate(() => errors), []);
    const disposed = await page.evaluate(async () => {
      const opening = open("half.ply", "slow");
      await new Promise((resolve) => setTimeout(resolve, 200));
      viewer.dispose();
      return [await opening, await open("half.ply")];
    });
    assert.match(disposed[0], abandoned);
    assert.equal(disposed[1], "Error: the viewer was disposed of");
    assert.deepEqual(complaints, []);
    changed.clear();
    await browser.close();
  },

  async "levels of detail are fetched as the camera needs them, coarse ones first"() {
    const browser = await launch();
    const { page, complaints } = await placed(browser, { maxGaussians: 5000 });
    await page.evaluate(() => {
      globalThis.load = () => viewer.load("city/lod-meta.json").then(({ gaussians, streamed }) => [gaussians, streamed], ({ message }) => message);
      let last;
      globalThis.ondrawn = (picture) => (last = { ...picture, at: performance.now() });
      /** Gaussians of the last picture, once it is complete and no other one follows. */
      globalThis.settled = async (camera) => {
        viewer.camera = camera;
        const set = performance.now();
        while (!(last.complete && last.at > set && performance.now() - last.at > 600)) await new Promise((resolve) => setTimeout(resolve, 50));
        return last.gaussians;
      };
    });
    // A chunk that is missing from the start is the load's error.
    withheld.add("means_l.webp");
    assert.match(await page.evaluate(() => load()), /_0\/means_l\.webp: the server answers 404/);
    assert.equal(await page.evaluate(() => viewer.info), undefined);
    withheld.clear();
    asked.length = 0;
    assert.deepEqual(await page.evaluate(() => load()), [9000, true]);
    assert.match(levelsAsked()[0], /^6_/, "the coarsest level comes first");
    const { target } = await page.evaluate(() => viewer.camera);
    const far = await page.evaluate((target) => settled({ position: [target[0], target[1], target[2] - 4000], target }), target);
    const before = asked.length;
    const near = await page.evaluate((target) => settled({ position: [target[0], target[1], target[2] - 1], target }), target);
    report("Gaussians from afar and near", far, near, "files", before, asked.length);
    assert.ok(far < near && near <= 5000 && asked.length > before, `${far} ${near}`);
    // What was there is not fetched again.
    const after = asked.length;
    assert.equal(await page.evaluate((target) => settled({ position: [target[0], target[1], target[2] - 4000], target }), target), far);
    assert.equal(asked.length, after);
    // The picture is that of the program, from the levels that it takes.
    const camera = await page.evaluate((target) => settled({ position: [target[0], target[1], target[2] - 1], target, fov: 50 }).then(() => viewer.camera), target);
    const { position, up } = camera;
    fs.writeFileSync(at("near.json"), JSON.stringify({ width: 256, height: 256, fov: camera.fov, up, frames: 1, keys: [{ position, target: camera.target }] }));
    run("render", inSite("city/lod-meta.json"), "--path", at("near.json"), "-o", at("near.png"), "--backend", "cpu", "--max-gaussians", "5000");
    const bytes = await page.evaluate(async () => {
      const bitmap = await createImageBitmap(await viewer.snapshot([256, 256]));
      const context = new OffscreenCanvas(256, 256).getContext("2d");
      context.drawImage(bitmap, 0, 0);
      return [...context.getImageData(0, 0, 256, 256).data];
    });
    const found = psnr(Buffer.from(bytes), fs.readFileSync(at("near.png")));
    report("dB against gs render", found);
    assert.ok(found > 45, `${found} dB`);
    assert.match(await page.evaluate(() => fetch("city/lod-meta.json").then((r) => r.blob()).then((blob) => viewer.load(blob, { name: "lod-meta.json" })).then(String, ({ message }) => message)), /open it by its address/);
    assert.equal(await page.evaluate(() => viewer.info.gaussians), 9000, "the scene before stays open");
    assert.deepEqual([...complaints, ...(await page.evaluate(() => errors))], []);
    await browser.close();
  },

  async "with WebGPU, levels of detail that come while a picture is drawn do not stop the engine"() {
    const browser = await launch("--enable-unsafe-webgpu");
    const { page, complaints } = await placed(browser, { backend: "wgpu" });
    const found = await page.evaluate(async () => {
      const pictures = [];
      globalThis.ondrawn = ({ gaussians }) => pictures.push(gaussians);
      await viewer.load("city/lod-meta.json");
      const { position, target } = viewer.camera;
      for (let k = 1; k < 40; k++) {
        viewer.camera = { position: position.map((x, axis) => x + (k / 40) * (target[axis] - x)), target };
        await new Promise((resolve) => setTimeout(resolve, 50));
      }
      return { backend: viewer.engine.backend, least: Math.min(...pictures), most: Math.max(...pictures) };
    });
    report("with WebGPU", JSON.stringify(found));
    assert.ok(found.backend === "wgpu" && found.least < found.most, JSON.stringify(found));
    assert.deepEqual([...complaints, ...(await page.evaluate(() => errors))], []);
    await browser.close();
  },

  async "parts of a scene that are missing, elsewhere or cut short are told, and the scene stays"() {
    const browser = await launch();
    const { page, complaints } = await placed(browser);
    const load = (options = {}) => page.evaluate((options) => viewer.load("city/lod-meta.json", options).then(({ gaussians }) => gaussians, ({ name, message }) => `${name}: ${message}`), options);
    const meta = fs.readdirSync(inSite("city")).filter((name) => name.startsWith("0_")).map((name) => inSite(`city/${name}/meta.json`));
    const before = meta.map((file) => fs.readFileSync(file));
    for (const [text, expected] of [
      ['{ "means": { "files": ["../../stolen"] } }', /expected names of at most 16 images beside it/],
      ['{ "means": { "files": ["http://localhost:1/x"] } }', /expected names of at most 16 images beside it/],
      ["<html>", /expected the meta.json of a SOG, found no JSON/],
      ['{ "version": 2, "means": { "files": ["quats.webp"] } }', /is damaged/],
    ]) {
      meta.forEach((file) => fs.writeFileSync(file, text));
      asked.length = 0;
      assert.equal(await load(), 9000);
      await page.evaluate(() => {
        errors.length = 0;
        const { target } = viewer.camera;
        viewer.camera = { position: [target[0], target[1], target[2] - 0.5], target };
      });
      await page.waitForFunction(() => errors.length > 0, { timeout: 30_000 });
      const [error] = await page.evaluate(() => errors);
      report(error);
      assert.match(error, expected);
      assert.ok(!asked.includes("stolen"));
      assert.equal(await page.evaluate(() => viewer.info.gaussians), 9000);
    }
    meta.forEach((file, k) => fs.writeFileSync(file, before[k]));
    // What never comes can be given up.
    assert.match(await page.evaluate(async () => {
      const abort = new AbortController();
      const loading = viewer.load("city/lod-meta.json?slow", { signal: abort.signal }).catch(({ name }) => name);
      setTimeout(() => abort.abort(), 300);
      return loading;
    }), /AbortError/);
    const abandoned = page.evaluate(() => viewer.load("city/lod-meta.json?slow").catch(({ name }) => name));
    await new Promise((resolve) => setTimeout(resolve, 300));
    assert.equal(await load(), 9000);
    assert.equal(await abandoned, "AbortError");
    // Chunks are asked for with the query of the address.
    assert.equal(await page.evaluate(() => viewer.load("city/lod-meta.json?key=7").then(({ gaussians }) => gaussians)), 9000);
    const disposed = page.evaluate(() => {
      const loading = viewer.load("city/lod-meta.json?slow").catch(({ name }) => name);
      return new Promise((resolve) => setTimeout(resolve, 300)).then(() => (viewer.dispose(), loading));
    });
    assert.equal(await disposed, "AbortError");
    assert.deepEqual(complaints, []);
    for (const [value, expected] of [[0, /maxGaussians is 0, and must be at least 1/], [-3, /maxGaussians is -3/], ["many", /maxGaussians is many/]]) {
      const other = await placed(browser, { maxGaussians: value });
      assert.match(await other.page.evaluate(() => viewer.load("city/lod-meta.json").catch(({ message }) => message)), expected);
      await other.page.close();
    }
    // In an element, too, what is there stays.
    const { page: inElement } = await opened(browser);
    assert.deepEqual(await set(inElement, "gs-viewer", "src", "city/lod-meta.json"), [["gs-viewer", "load", 9000]]);
    withheld.add("quats.webp");
    const told = await inElement.evaluate(() => told.length);
    await inElement.$eval("gs-viewer", ({ viewer }) => {
      const { target } = viewer.camera;
      viewer.camera = { position: [target[0], target[1], target[2] - 0.5], target };
    });
    await inElement.waitForFunction((from) => told.slice(from).some(([, event]) => event === "error"), { timeout: 30_000 }, told);
    assert.equal(await inElement.$eval("gs-viewer", ({ viewer }) => viewer.info.gaussians), 9000);
    withheld.clear();
    await browser.close();
  },

  async "reset takes the first camera, of the file or of the call, and not one that was set"() {
    const browser = await launch();
    const { page, open } = await placed(browser);
    const position = () => page.evaluate(() => viewer.camera.position.map((number) => Math.round(1e4 * number) / 1e4));
    await open("scene.sog");
    const first = await position();
    await page.evaluate(() => (viewer.camera = { position: [0, 0, -9] }));
    assert.deepEqual(await position(), [0, 0, -9]);
    await page.evaluate(() => viewer.reset());
    assert.deepEqual(await position(), first);
    await open("scene.sog", undefined, { camera: { position: [1, 0, -4], target: [0, 0, 0] } });
    assert.deepEqual(await position(), [1, 0, -4]);
    await page.evaluate(() => (viewer.camera = { fov: 20, position: [0, 2, -9] }));
    await page.evaluate(() => viewer.reset());
    assert.deepEqual(await position(), [1, 0, -4]);
    assert.notEqual(await page.evaluate(() => viewer.camera.fov), 20);
    await browser.close();
  },

  async "any direction can be up, and the camera turns around it"() {
    const browser = await launch();
    const { page } = await opened(browser);
    const camera = () => page.$eval("gs-viewer", ({ viewer }) => viewer.camera);
    const { position: before, target } = await camera();
    const distance = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));
    for (const [name, axis, sign, scene] of [["z", 2, 1, "second.splat"], ["-x", 0, -1, "scene.sog"], ["y", 1, 1, "second.splat"], ["-y", 1, -1, "scene.sog"]]) {
      await page.$eval("gs-viewer", (element, name) => element.setAttribute("up", name), name);
      assert.equal((await set(page, "gs-viewer", "src", scene))[0][1], "load");
      const first = await camera();
      assert.equal(first.up[axis], sign, name);
      // Slightly above, and as far away.
      const above = sign * (first.position[axis] - first.target[axis]);
      assert.ok(above > 0.2 * distance(before, target) && above < 0.5 * distance(before, target), `${name}: ${first.position}`);
      assert.ok(Math.abs(distance(first.position, first.target) / distance(before, target) - 1) < 0.05);
      await page.$eval("gs-viewer", (element) => element.shadowRoot.querySelector("canvas").focus());
      for (let k = 0; k < 5; k++) await page.keyboard.press("ArrowRight");
      const turned = await camera();
      assert.ok(Math.abs(turned.position[axis] - first.position[axis]) < 1e-4, "around the axis that is up");
      assert.ok(distance(turned.position, first.position) > 0.1 * distance(before, target));
      // To the right: the camera goes to the left of where it looked, seen with this way up.
      const ahead = first.target.map((x, k) => x - first.position[k]);
      const right = [ahead[1] * first.up[2] - ahead[2] * first.up[1], ahead[2] * first.up[0] - ahead[0] * first.up[2], ahead[0] * first.up[1] - ahead[1] * first.up[0]];
      const moved = turned.position.reduce((sum, x, k) => sum + (x - first.position[k]) * right[k], 0);
      assert.ok(moved < 0, `${name}: ${moved}`);
    }
    await page.$eval("gs-viewer", (element) => element.removeAttribute("up"));
    assert.equal((await set(page, "gs-viewer", "src", "second.splat"))[0][1], "load");
    assert.ok(distance((await camera()).position, before) < 0.05 * distance(before, target), "as before");
    await browser.close();
  },

  async "elements fetch their source once, also when they are moved"() {
    const browser = await launch();
    asked.length = 0;
    const { page } = await opened(browser);
    const count = () => ["scene.sog", "photo.gsi", "poster.png", "viewer-worker.js"].map((name) => asked.filter((other) => other === name).length);
    assert.deepEqual(await count(), [1, 1, 1, 1]);
    const before = await snapshot(page, [64, 48]);
    const isSame = await page.evaluate(async () => {
      const elements = [...document.querySelectorAll("gs-viewer, gsi-img")];
      const { viewer } = elements[0];
      const inside = document.body.appendChild(document.createElement("section"));
      inside.append(...elements);
      await new Promise((resolve) => setTimeout(resolve, 500));
      return elements[0].viewer === viewer && elements[1].shadowRoot.querySelector("canvas") !== null;
    });
    assert.ok(isSame);
    assert.ok(before.equals(await snapshot(page, [64, 48])));
    assert.deepEqual(await count(), [1, 1, 1, 1]);
    // A source that is set on the way counts.
    const after = await page.evaluate(() => told.length);
    await page.evaluate(() => {
      const element = document.querySelector("gs-viewer");
      element.remove();
      element.src = "half.ply";
      document.body.append(element);
    });
    await told(page, "gs-viewer", after);
    assert.equal(await page.$eval("gs-viewer", ({ viewer }) => viewer.info.gaussians), 200);
    await browser.close();
  },

  async "after the decoder or its worker has stopped, the next image is decoded"() {
    changed.set("gs_picture.js", { "static decode(bytes, partial) {": `if (bytes.length === 60) ${STOP}` });
    changed.set("gsi-worker.js", { "queue = queue.then(async () => {": `if (bytes.byteLength === 61) {
      setTimeout(() => { throw new Error("the worker broke"); }, 500);
      await new Promise(() => {});
    }` });
    for (const length of [60, 61]) fs.writeFileSync(inSite(`stops-${length}.gsi`), fs.readFileSync(inSite("photo.gsi")).subarray(0, length));
    const browser = await launch();
    const { page } = await opened(browser);
    const decoded = (name) => page.evaluate(async (name) => gsi.decode(await fetch(name)).then(({ width }) => width, ({ message }) => message), name);
    assert.match(await decoded("stops-60.gsi"), /^http.*\/stops-60\.gsi: the decoder stopped: unreachable/);
    assert.equal(await decoded("photo.gsi"), 48);
    for (const [name, expected] of [["stops-60.gsi", "stops-60.gsi: the decoder stopped: unreachable"], ["stops-61.gsi", /^stops-61\.gsi: .*the worker broke/]]) {
      const [[, event, message]] = await set(page, "gsi-img", "src", name);
      report(message);
      assert.equal(event, "error");
      assert.match(message, new RegExp(expected));
      assert.deepEqual(await set(page, "gsi-img", "src", "photo.gsi"), [["gsi-img", "load", 48]]);
    }
    // Another image waits for the one at which the worker breaks.
    const messages = await page.evaluate(() => Promise.all(["stops-61.gsi", "photo.gsi"].map((name) => new Promise((resolve) => {
      const element = document.body.appendChild(document.createElement("gsi-img"));
      for (const event of ["load", "error"]) element.addEventListener(event, ({ detail }) => resolve(detail.message ?? event));
      element.setAttribute("src", name);
    }))));
    assert.match(messages[0], /^stops-61\.gsi: .*the worker broke/);
    assert.match(messages[1], /^photo\.gsi: .*the worker broke/);
    changed.clear();
    await browser.close();
  },

  "the package is small"() {
    const folder = inSite("node_modules/gaussian-splats");
    const sizes = Object.fromEntries(fs.readdirSync(folder).map((name) => [name, gzipSync(fs.readFileSync(path.join(folder, name)), { level: 9 }).length]));
    const decoder = Object.keys(sizes).filter((name) => /^(gsi|gs_picture|png)/.test(name));
    const parts = [
      ["the package", 950_000, fs.statSync(archive).size, Object.keys(sizes)],
      ["the decoder", 250_000, decoder.reduce((sum, name) => sum + sizes[name], 0), decoder],
    ];
    for (const [part, limit, size, names] of parts) {
      report(part, size, "bytes, compressed");
      const list = names.sort((a, b) => sizes[b] - sizes[a]).map((name) => `${name} ${sizes[name]}`).join(", ");
      assert.ok(size <= limit, `${part} has ${size} bytes and may have ${limit}, compressed: ${list}`);
    }
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

await runTests(tests, process.argv[7], async () => {
  server.close();
  await close();
});
