// Tests the built page in headless Chromium, and compares what it computes with the program gs.
//
// node page.mjs BROWSER PAGE GS PLACE [NAME]: the browser, the folder of the page, the program, and a
// folder with node_modules where files and screenshots are kept; with NAME, a regular expression, only
// the tests whose name matches it.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { createRequire } from "node:module";
import path from "node:path";
import zlib from "node:zlib";

const [browserName, pageFolder, gs, place, only = ""] = process.argv.slice(2);
const puppeteer = createRequire(path.resolve(place, "x.js"))("puppeteer-core");
const files = path.join(path.resolve(place), "files");
fs.rmSync(files, { recursive: true, force: true });
fs.mkdirSync(files, { recursive: true });
const at = (name) => path.join(files, name);
const run = (...words) => execFileSync(gs, words, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });

// A scene below a long path, as on a static host.
const UNDER = "/some/where/below/";
const TYPES = { html: "text/html", js: "text/javascript", css: "text/css", wasm: "application/wasm" };
const server = http.createServer((request, response) => {
  const { pathname } = new URL(request.url, "http://localhost");
  const file = path.join(pageFolder, pathname.slice(UNDER.length) || "index.html");
  if (!pathname.startsWith(UNDER) || !fs.existsSync(file)) return response.writeHead(404).end();
  response.writeHead(200, { "content-type": TYPES[path.extname(file).slice(1)] ?? "text/plain" });
  response.end(fs.readFileSync(file));
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));
const address = (backend) => `http://localhost:${server.address().port}${UNDER}?backend=${backend}`;

const browser = await puppeteer.launch({
  executablePath: execFileSync("which", [browserName], { encoding: "utf8" }).trim(),
  args: ["--no-sandbox", "--enable-unsafe-webgpu"],
  protocolTimeout: 900_000,
});

/** A page whose engine is ready; `complaints` are its console's errors. */
async function opened(url, width = 1100, height = 900) {
  const page = await browser.newPage();
  const complaints = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  await page.setViewport({ width, height });
  await page.goto(url);
  await page.waitForFunction(
    "document.body.dataset.backend || !document.getElementById('problem').hidden", { timeout: 120_000 });
  const problem = await page.$eval("#problem", (element) => (element.hidden ? "" : element.textContent));
  assert.equal(problem, "");
  return { page, complaints };
}

/** Asks the engine of a page; bytes come back as a Buffer. */
async function ask(page, request, rest = {}) {
  const answer = await page.evaluate(async (request, rest) => {
    const answer = await globalThis.gsPage.ask(request, rest);
    if (!(answer instanceof Uint8Array)) return { json: answer };
    let text = "";
    for (let k = 0; k < answer.length; k += 32768) text += String.fromCharCode(...answer.subarray(k, k + 32768));
    return { bytes: btoa(text) };
  }, request, rest);
  return answer.bytes === undefined ? answer.json : Buffer.from(answer.bytes, "base64");
}

/** Gives a file to the page as a drop does, and waits for a frame or a message. */
async function drop(page, name, bytes, type = "") {
  const before = await page.evaluate(() => Number(document.body.dataset.frames ?? 0));
  await page.evaluate((name, text, type) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const transfer = new DataTransfer();
    transfer.items.add(new File([bytes], name, { type }));
    window.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
  }, name, bytes.toString("base64"), type);
  await page.waitForFunction(
    (before) => Number(document.body.dataset.frames ?? 0) > before || !document.getElementById("problem").hidden,
    { timeout: 300_000 }, before);
  return page.$eval("#problem", (element) => (element.hidden ? "" : element.textContent));
}

/** PSNR of RGBA pixels against those of a PNG, dB. */
function psnr(pixels, png) {
  const other = decoded(png);
  assert.equal(pixels.length / 4, other.length / 3);
  let sum = 0;
  for (let i = 0, j = 0; i < pixels.length; i += 4, j += 3) {
    for (let k = 0; k < 3; k++) sum += (pixels[i + k] - other[j + k]) ** 2;
  }
  return 10 * Math.log10((255 ** 2 * other.length) / sum);
}

/** The RGB bytes of a PNG that gs has written. */
function decoded(png) {
  const [width, height] = [png.readUInt32BE(16), png.readUInt32BE(20)];
  assert.deepEqual([png[24], png[25]], [8, 2], "8 bits, RGB");
  const parts = [];
  for (let k = 8; k < png.length; k += 12 + png.readUInt32BE(k)) {
    if (png.toString("latin1", k + 4, k + 8) === "IDAT") parts.push(png.subarray(k + 8, k + 8 + png.readUInt32BE(k)));
  }
  const raw = zlib.inflateSync(Buffer.concat(parts));
  const [line, out] = [3 * width, Buffer.alloc(3 * width * height)];
  const paeth = (a, b, c) => {
    const [x, y, z] = [a, b, c].map((value) => Math.abs(a + b - c - value));
    return x <= y && x <= z ? a : y <= z ? b : c;
  };
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < line; x++) {
      const left = x >= 3 ? out[y * line + x - 3] : 0;
      const above = y > 0 ? out[(y - 1) * line + x] : 0;
      const corner = x >= 3 && y > 0 ? out[(y - 1) * line + x - 3] : 0;
      const add = [0, left, above, (left + above) >> 1, paeth(left, above, corner)][raw[y * (line + 1)]];
      out[y * line + x] = raw[y * (line + 1) + 1 + x] + add;
    }
  }
  return out;
}

const tests = {
  async "a fit on the CPU ends as the program's"() {
    const { page, complaints } = await opened(address("cpu"));
    await page.evaluate(() => {
      globalThis.longest = 0;
      new PerformanceObserver((list) => {
        for (const { duration, startTime } of list.getEntries()) (globalThis.tasks ??= []).push([startTime, duration]), globalThis.longest = Math.max(globalThis.longest, duration);
      }).observe({ type: "longtask" });
    });
    const fit = await fitted(page, { preset: "standard", gaussians: "9000" });
    const native = nativeFit("cpu", await fitFiles(page));
    report("fit in wasm, s", fit.seconds, "native, 1 thread, baseline, s", native.seconds, "ratio", fit.seconds / native.seconds);
    report("first picture after, s", fit.first, "main thread blocked at most, ms", await page.evaluate(() => globalThis.longest));
    assert.ok(Math.abs(fit.psnr - native.psnr) < 0.1, `${fit.psnr} dB, natively ${native.psnr}`);
    report("long tasks (start, ms)", JSON.stringify(await page.evaluate(() => globalThis.tasks?.slice(0, 12))));
    const once = await ask(page, "memory");
    await fitted(page, { preset: "quick", gaussians: "9000" });
    await fitted(page, { preset: "quick", gaussians: "9000" });
    const twice = await ask(page, "memory");
    report("memory after one fit, MiB", once / 2 ** 20, "after three", twice / 2 ** 20);
    assert.ok(twice <= once, `${twice} bytes after three fits, ${once} after one`);
    await screenshots(page, "fit");
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "a fit with WebGPU ends as the program's"() {
    const { page, complaints } = await opened(address("wgpu"));
    assert.equal(await page.evaluate(() => document.body.dataset.backend), "wgpu");
    // Software drivers take minutes for what a GPU does in a second.
    const fit = await fitted(page, { preset: "quick", gaussians: "1000" });
    const native = nativeFit("cpu", await fitFiles(page));
    report("fit with WebGPU, dB", fit.psnr, "native on the CPU, dB", native.psnr);
    assert.ok(Math.abs(fit.psnr - native.psnr) < 0.1, `${fit.psnr} dB, natively ${native.psnr}`);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "two policies side by side, single steps and rounds"() {
    const { page, complaints } = await opened(address("cpu"));
    await page.select("#preset", "quick");
    await page.select("#policy-b", "image-gs");
    await page.click("#gaussians", { count: 3 });
    await page.keyboard.type("300");
    await page.click("#start");
    await page.waitForFunction(() => /Step 50 of 50/.test(document.querySelector("#slot-b figcaption").textContent), { timeout: 300_000 });
    const rounds = await page.$$eval("#rounds li", (items) => items.map((item) => item.textContent));
    assert.ok(rounds.some((text) => text.startsWith("left, after step")) && rounds.some((text) => text.startsWith("right")), rounds.join());
    assert.ok(rounds.some((text) => /\d+ added where the error is largest/.test(text)), rounds.join());
    for (const kind of ["ellipses", "error", "target", "picture"]) {
      await page.select("#show", kind);
      await ask(page, "memory");
    }
    await page.select("#policy-b", "none");
    await page.select("#preset", "standard");
    await page.evaluate(() => (document.querySelector("#slot-a figcaption").textContent = ""));
    await page.click("#start");
    await page.waitForFunction(() => /Step/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 60_000 });
    await page.click("#pause");
    await ask(page, "memory");
    const step = async () => Number(/Step (\d+)/.exec(await page.$eval("#slot-a figcaption", (element) => element.textContent))?.[1] ?? 0);
    const before = await step();
    await page.click("#step");
    await page.waitForFunction((before) => Number(/Step (\d+)/.exec(document.querySelector("#slot-a figcaption").textContent)?.[1]) > before, {}, before);
    assert.equal(await step(), before + 1);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "scenes of all formats are drawn as the program draws them"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("made.ply"));
    for (const name of ["made.ply", "made.splat", "made.spz", "made-3.spz", "made.sog", "made.gltf", "made.glb"]) {
      if (name !== "made.ply") run("convert", at("made.ply"), at(name), ...(name === "made-3.spz" ? ["--spz-version", "3"] : []));
      assert.equal(await drop(page, name, fs.readFileSync(at(name))), "", name);
      run("render", at(name), "-o", at(`${name}.png`), "--size", "320x240", "--backend", "cpu");
      const pixels = await ask(page, "viewPixels", { frame: { width: 320, height: 240 } });
      const found = psnr(pixels, fs.readFileSync(at(`${name}.png`)));
      assert.ok(found > 55, `${name}: ${found} dB against gs render`);
    }
    const sog = await ask(page, "sceneFile", { name: "again.sog" });
    fs.writeFileSync(at("again.sog"), sog);
    assert.match(run("info", at("again.sog")), /SOG/);
    await screenshots(page, "view");
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "a compact image and a 2D scene are drawn"() {
    const { page, complaints } = await opened(address("cpu"));
    await fitted(page, { preset: "quick", gaussians: "300" });
    for (const [kind, name] of [["scene", "a.gs2d.safetensors"], ["gsi", "a.gsi"]]) {
      const bytes = await ask(page, "fitFile", { slot: "a", kind });
      fs.writeFileSync(at(name), bytes);
      assert.equal(await drop(page, name, bytes), "", name);
      run("render", at(name), "-o", at(`${name}.png`), "--backend", "cpu");
      const found = psnr(await ask(page, "viewPixels", { frame: { width: 768, height: 512 } }), fs.readFileSync(at(`${name}.png`)));
      assert.ok(found > 50, `${name}: ${found} dB against gs render`);
    }
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "broken files are refused, and the page lives on"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("good.ply"));
    const good = fs.readFileSync(at("good.ply"));
    const broken = { "short.ply": good.subarray(0, good.length / 2), "junk.spz": Buffer.from("no scene"), "empty.sog": Buffer.alloc(0), "notes.txt": Buffer.from("hello") };
    for (const [name, bytes] of Object.entries(broken)) {
      const problem = await drop(page, name, bytes);
      assert.ok(problem.includes(name), `${name}: ${problem}`);
    }
    const image = await drop(page, "broken.png", Buffer.from("\x89PNG no picture"), "image/png");
    assert.match(image, /broken.png is no image that this browser reads/);
    assert.equal(await drop(page, "good.ply", good), "");
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "keys and pointers move the camera"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("good.ply"));
    assert.equal(await drop(page, "good.ply", fs.readFileSync(at("good.ply"))), "");
    const frames = () => page.evaluate(() => Number(document.body.dataset.frames));
    const moved = async (action) => {
      const before = await frames();
      await action();
      await page.waitForFunction((before) => Number(document.body.dataset.frames) > before, { timeout: 60_000 }, before);
    };
    await page.focus("#canvas-view");
    for (const key of ["ArrowLeft", "w", "+", "Home"]) await moved(() => page.keyboard.press(key));
    const box = await (await page.$("#canvas-view")).boundingBox();
    await moved(async () => {
      await page.mouse.move(box.x + 50, box.y + 50);
      await page.mouse.down();
      await page.mouse.move(box.x + 120, box.y + 70);
      await page.mouse.up();
    });
    await moved(() => page.mouse.wheel({ deltaY: 100 }));
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "a page of one file opens from disk"() {
    makeScene(at("one.ply"));
    run("page", at("one.ply"), "-o", at("one.html"));
    const { page, complaints } = await opened(`file://${at("one.html")}?backend=cpu`);
    await page.waitForFunction(() => Number(document.body.dataset.frames ?? 0) > 0, { timeout: 60_000 });
    assert.match(await page.$eval("#view-words", (element) => element.textContent), /3DGS PLY, 400 Gaussians/);
    report("page of one file, bytes", fs.statSync(at("one.html")).size);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "controls have names, and the theme changes"() {
    const { page } = await opened(address("cpu"));
    const unnamed = await page.$$eval("button, select, input:not([hidden]), canvas", (elements) =>
      elements.filter((element) => !(element.textContent.trim() || element.labels?.length || element.getAttribute("aria-label"))).map((element) => element.id));
    assert.deepEqual(unnamed, []);
    const color = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    const before = await color();
    await page.click("#theme");
    assert.notEqual(await color(), before);
    await page.setViewport({ width: 360, height: 640 });
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= 360), "no sideways scrolling at 360 px");
    await page.close();
  },

  async "the page is small"() {
    const names = fs.readdirSync(pageFolder).filter((name) => /\.(html|js|css|wasm)$/.test(name) && !/one-file|inside/.test(name));
    const size = names.reduce((sum, name) => sum + zlib.brotliCompressSync(fs.readFileSync(path.join(pageFolder, name))).length, 0);
    report("the page compressed by brotli, bytes", size);
    assert.ok(size < 1_500_000, `${size} bytes`);
  },

  async "150,000 Gaussians are drawn on the CPU, if they are there"() {
    const biker = path.join(process.env.GS_DATA ?? "../shared/data", "splats/biker.compressed.ply");
    if (!fs.existsSync(biker)) return report("skipped: no test data", biker);
    const { page } = await opened(address("cpu"));
    assert.equal(await drop(page, "biker.ply", fs.readFileSync(biker)), "");
    const { home } = await page.evaluate(() => globalThis.gsPage.view.info);
    const times = [];
    for (let k = 0; k < 12; k++) {
      const position = home.position.map((value, axis) => value + (axis === 0 ? 0.01 * k : 0));
      times.push((await ask(page, "frame", { frame: { width: 640, height: 480, camera: { ...home, position } } })).took);
    }
    times.sort((a, b) => a - b);
    report("biker at 640x480, frames/s by the median", 1000 / times[6], "fastest", 1000 / times[0]);
    await page.close();
  },
};

/** Runs a fit of the built-in scene until its end. */
async function fitted(page, { preset, gaussians }) {
  await page.evaluate(() => document.getElementById("tab-fit").click());
  await page.select("#preset", preset);
  await page.click("#gaussians", { count: 3 });
  await page.keyboard.type(gaussians);
  await page.evaluate(() => (document.querySelector("#slot-a figcaption").textContent = ""));
  const started = Date.now();
  await page.click("#start");
  await page.waitForFunction(() => /px|Step/.test(document.querySelector("#slot-a figcaption").textContent) && document.getElementById("canvas-a").width > 1, { timeout: 600_000, polling: 20 });
  const first = (Date.now() - started) / 1000;
  await page.waitForFunction(() => /Step (\d+) of \1:/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 900_000 });
  const words = await page.$eval("#slot-a figcaption", (element) => element.textContent);
  const [, psnr, seconds] = /([\d.]+) dB, ([\d.]+) s/.exec(words).map(Number);
  return { psnr, seconds, first };
}

/** Writes the target and the settings of a page's fit. */
async function fitFiles(page) {
  fs.writeFileSync(at("target.png"), await ask(page, "fitFile", { slot: "a", kind: "target" }));
  fs.writeFileSync(at("settings.toml"), await ask(page, "fitFile", { slot: "a", kind: "settings" }));
}

/** The same fit by the program. */
function nativeFit(backend) {
  run("fit", at("target.png"), "--settings", at("settings.toml"), "--backend", backend, "--threads", "1", "--simd", "baseline", "-o", at("native"));
  return JSON.parse(fs.readFileSync(at("native/summary.json")));
}

/** A scene of 400 Gaussians of degree 1, as a PLY in text. */
function makeScene(file) {
  const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...Array.from({ length: 9 }, (_, k) => `f_rest_${k}`), "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
  const rows = [];
  for (let i = 0; i < 400; i++) {
    const wave = (k) => Math.sin(1.7 * i + 2.3 * k);
    const numbers = [2 * wave(1), 2 * wave(2), 2 * wave(3), wave(4), wave(5), wave(6), ...Array.from({ length: 9 }, (_, k) => 0.3 * wave(7 + k)), 2 * wave(20), -2 + wave(21), -2 + wave(22), -2.5, 1, wave(23), wave(24), wave(25)];
    rows.push(numbers.map((number) => number.toFixed(6)).join(" "));
  }
  const header = ["ply", "format ascii 1.0", "element vertex 400", ...names.map((name) => `property float ${name}`), "end_header"];
  fs.writeFileSync(file, `${[...header, ...rows].join("\n")}\n`);
}

/** Keeps pictures of the page at three widths, to be looked at. */
async function screenshots(page, name) {
  for (const [width, height] of [[360, 740], [1280, 900], [2560, 1440]]) {
    await page.setViewport({ width, height });
    await new Promise((resolve) => setTimeout(resolve, 1500));
    await page.screenshot({ path: path.join(place, `${name}-${width}.png`) });
  }
  await page.setViewport({ width: 1100, height: 900 });
}

function report(...words) {
  console.log("  ", ...words.map((word) => (typeof word === "number" ? Math.round(word * 1000) / 1000 : word)));
}

let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  if (!new RegExp(only).test(name)) continue;
  const started = Date.now();
  try {
    await test();
    console.log(`ok ${name} (${((Date.now() - started) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed += 1;
    console.log(`FAILED ${name}\n${error.stack}`);
  }
}
await browser.close();
server.close();
console.log(failed === 0 ? "all tests passed" : `${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
