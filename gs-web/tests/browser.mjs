// The built page in headless Chromium, for tests and measurements: how it is served and opened, given
// files, asked, and compared with the program gs.
//
// The arguments of the command are BROWSER PAGE GS PLACE: the browser, the folder of the page, the
// program, and a folder with node_modules where screenshots are kept.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { createRequire } from "node:module";
import os from "node:os";
import path from "node:path";
import { decoded } from "./png.mjs";

export const [browserName, pageFolder, program, place] = process.argv.slice(2);
const puppeteer = createRequire(path.resolve(place, "x.js"))("puppeteer-core");
// Two processes may test different parts at a time.
const files = fs.mkdtempSync(path.join(os.tmpdir(), "gs-web-"));
process.on("exit", () => fs.rmSync(files, { recursive: true, force: true }));

/** The path of a file of the tests. */
export const at = (name) => path.join(files, name);
/** Runs the program, and returns what it prints. */
export const run = (...words) => execFileSync(program, words, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });

// The page below a long path, as on a static host; and below another, where it is cross-origin isolated.
const UNDER = "/some/where/below/";
const ISOLATED = "/some/where/isolated/";
const ISOLATION = { "cross-origin-opener-policy": "same-origin", "cross-origin-embedder-policy": "require-corp" };
const TYPES = { html: "text/html", js: "text/javascript", css: "text/css", wasm: "application/wasm" };
const server = http.createServer((request, response) => {
  const { pathname } = new URL(request.url, "http://localhost");
  const under = [UNDER, ISOLATED].find((under) => pathname.startsWith(under));
  const file = path.join(pageFolder, pathname.slice(under?.length) || "index.html");
  if (!under || !fs.existsSync(file)) return response.writeHead(404).end();
  const type = TYPES[path.extname(file).slice(1)] ?? "text/plain";
  response.writeHead(200, { "content-type": type, ...(under === ISOLATED && ISOLATION) });
  response.end(fs.readFileSync(file));
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));
/** The page's address; with a number of threads, that where it is cross-origin isolated. */
export const address = (backend, threads) =>
  `http://localhost:${server.address().port}${threads ? ISOLATED : UNDER}?backend=${backend}${threads ? `&threads=${threads}` : ""}`;
/** Whether the page was built with threads. */
export const hasThreads = fs.existsSync(path.join(pageFolder, "threads"));

const executablePath = execFileSync("which", [browserName], { encoding: "utf8" }).trim();
/** Starts a browser; WebGPU is computed by SwiftShader where there is no GPU. */
export const launch = (...more) => puppeteer.launch({ executablePath, args: ["--no-sandbox", ...more], protocolTimeout: 900_000 });
const browser = await launch("--enable-unsafe-webgpu");

export async function close() {
  await browser.close();
  server.close();
}

/** A page whose engine is ready; `complaints` are its console's errors. `before` runs in the page first. */
export async function opened(url, { before, within = browser } = {}) {
  const page = await within.newPage();
  const complaints = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.message));
  await page.setViewport({ width: 1100, height: 900 });
  if (before) await page.evaluateOnNewDocument(before);
  await page.goto(url);
  await page.waitForFunction("document.body.dataset.backend || !document.getElementById('problem').hidden", { timeout: 120_000 });
  assert.equal(await problem(page), "");
  return { page, complaints };
}

/** What the page says computes, and why. */
export const status = (page) => page.$eval("#status", (element) => element.textContent);

/** What the page says went wrong. */
export const problem = (page) => page.$eval("#problem", (element) => (element.hidden ? "" : element.textContent));

/** Asks the engine of a page; bytes come back as a Buffer. */
export async function ask(page, request, rest = {}) {
  const answer = await page.evaluate(async (request, rest) => {
    const answer = await globalThis.gsPage.ask(request, rest);
    if (!(answer instanceof Uint8Array)) return { json: answer };
    let text = "";
    for (let k = 0; k < answer.length; k += 32768) text += String.fromCharCode(...answer.subarray(k, k + 32768));
    return { bytes: btoa(text) };
  }, request, rest);
  return answer.bytes === undefined ? answer.json : Buffer.from(answer.bytes, "base64");
}

/** Gives a file to the page as a drop does. */
export async function give(page, name, bytes, type = "") {
  await page.evaluate((name, text, type) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const transfer = new DataTransfer();
    transfer.items.add(new File([bytes], name, { type }));
    window.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
  }, name, bytes.toString("base64"), type);
}

/** Gives a file to the page, and returns what the page says went wrong, once it is open or refused. */
export async function drop(page, name, bytes, type = "") {
  await give(page, name, bytes, type);
  await page.evaluate(() => globalThis.gsPage.opening);
  return problem(page);
}

/** The text below the picture of a fit. */
export const caption = (page, slot = "a") => page.$eval(`#slot-${slot} figcaption`, (element) => element.textContent);

/** The step that a fit has come to. */
export const stepOf = async (page, slot = "a") => Number(/[Ss]tep (\d+)/.exec(await caption(page, slot))?.[1] ?? 0);

/** Waits until a fit is at this step or later. */
export const reached = (page, step, slot = "a") =>
  page.waitForFunction(
    (step, slot) => Number(/Step (\d+)/.exec(document.querySelector(`#slot-${slot} figcaption`).textContent)?.[1] ?? 0) >= step,
    { timeout: 300_000, polling: 50 }, step, slot);

/** Fills in the form of fits. */
export async function choose(page, { preset, gaussians, policyB }) {
  await page.evaluate(() => document.getElementById("tab-fit").click());
  await page.select("#preset", preset);
  if (policyB) await page.select("#policy-b", policyB);
  await page.$eval("#gaussians", (element, value) => (element.value = value), gaussians);
  await page.evaluate(() => (document.querySelector("#slot-a figcaption").textContent = ""));
}

/** Runs a fit until its end: of an image that is given, `{ name, bytes }`, or of the built-in one. */
export async function fitted(page, { image, ...choices }) {
  await choose(page, choices);
  const started = Date.now();
  await (image ? give(page, image.name, image.bytes, "image/png") : page.click("#start"));
  await page.waitForFunction(
    () => /px|Step/.test(document.querySelector("#slot-a figcaption").textContent) && document.getElementById("canvas-a").width > 1,
    { timeout: 600_000, polling: 20 });
  const first = (Date.now() - started) / 1000;
  await page.waitForFunction(() => /Step (\d+) of \1:/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 900_000 });
  const [, psnr, seconds] = /([\d.]+) dB, ([\d.]+) s/.exec(await caption(page)).map(Number);
  return { psnr, seconds, first };
}

/** The fit of the page by the program, from the target and the settings that the page saves, with `more` flags. */
export async function nativeFit(page, more = ["--threads", "1", "--simd", "baseline"]) {
  fs.writeFileSync(at("target.png"), await ask(page, "fitFile", { slot: "a", kind: "target" }));
  fs.writeFileSync(at("settings.toml"), await ask(page, "fitFile", { slot: "a", kind: "settings" }));
  run("fit", at("target.png"), "--settings", at("settings.toml"), "--backend", "cpu", ...more, "-o", at("native"));
  return JSON.parse(fs.readFileSync(at("native/summary.json")));
}

/** PSNR of RGBA pixels against those of a PNG that gs has written, dB. */
export function psnr(pixels, png) {
  const other = decoded(png);
  assert.equal(pixels.length / 4, other.length / 3);
  let sum = 0;
  for (let i = 0, j = 0; i < pixels.length; i += 4, j += 3) {
    for (let k = 0; k < 3; k++) sum += (pixels[i + k] - other[j + k]) ** 2;
  }
  return 10 * Math.log10((255 ** 2 * other.length) / sum);
}

/** A scene of 400 Gaussians of degree 1, as a PLY in text. */
export function makeScene(file, count = 400) {
  const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...Array.from({ length: 9 }, (_, k) => `f_rest_${k}`), "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
  const rows = [];
  for (let i = 0; i < count; i++) {
    const wave = (k) => Math.sin(1.7 * i + 2.3 * k);
    const numbers = [2 * wave(1), 2 * wave(2), 2 * wave(3), wave(4), wave(5), wave(6), ...Array.from({ length: 9 }, (_, k) => 0.3 * wave(7 + k)), 2 * wave(20), -2 + wave(21), -2 + wave(22), -2.5, 1, wave(23), wave(24), wave(25)];
    rows.push(numbers.map((number) => number.toFixed(6)).join(" "));
  }
  const header = ["ply", "format ascii 1.0", `element vertex ${count}`, ...names.map((name) => `property float ${name}`), "end_header"];
  fs.writeFileSync(file, `${[...header, ...rows].join("\n")}\n`);
}

/** Keeps pictures of the page at several widths and in both themes, to be looked at. */
export async function screenshots(page, name) {
  for (const [width, height] of [[360, 740], [1280, 900], [3840, 2160]]) {
    await page.setViewport({ width, height });
    for (const theme of ["light", "dark"]) {
      if (theme !== (await page.evaluate(() => document.documentElement.dataset.theme ?? "light"))) await page.click("#theme");
      await new Promise((resolve) => setTimeout(resolve, 600));
      await page.screenshot({ path: path.join(place, `${name}-${width}-${theme}.png`), fullPage: width === 360 });
    }
  }
  await page.setViewport({ width: 1100, height: 900 });
}

export function report(...words) {
  console.log("  ", ...words.map((word) => (typeof word === "number" ? Math.round(word * 1000) / 1000 : word)));
}
