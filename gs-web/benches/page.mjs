// Measures the page in headless Chromium: its size, a fit without WebGPU against the program, how long
// the main thread is blocked, memory, and the frames of a large scene.
//
// node gs-web/benches/page.mjs chromium target/page target/release/gs target/web-test, after
// cargo xtask web, cargo build --release and cargo xtask web --test --install.

import assert from "node:assert/strict";
import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import zlib from "node:zlib";
import { address, ask, close, drop, fitted, nativeFit, opened, pageFolder, report } from "../tests/browser.mjs";

const load = () => os.loadavg()[0];

function size() {
  const names = fs.readdirSync(pageFolder).filter((name) => /\.(html|js|css|wasm)$/.test(name) && !/one-file|inside/.test(name));
  const bytes = names.reduce((sum, name) => sum + zlib.brotliCompressSync(fs.readFileSync(path.join(pageFolder, name))).length, 0);
  report("the page compressed by brotli, bytes", bytes);
  assert.ok(bytes < 1_500_000);
}

async function cpuFit() {
  const { page } = await opened(address("cpu"));
  await page.evaluate(() => {
    globalThis.tasks = [];
    new PerformanceObserver((list) => globalThis.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask" });
  });
  const fit = await fitted(page, { preset: "standard", gaussians: "9000" });
  const tasks = await page.evaluate(() => globalThis.tasks);
  const native = await nativeFit(page);
  report("load", load(), "fit, s", fit.seconds, "by the program, s", native.seconds, "ratio", fit.seconds / native.seconds, "dB", fit.psnr, native.psnr);
  report("first picture after, s", fit.first, "main thread blocked for more than 50 ms, ms", JSON.stringify(tasks));
  assert.ok(Math.abs(fit.psnr - native.psnr) < 0.1);
  const firsts = [];
  const memory = [await ask(page, "memory")];
  for (let k = 0; k < 4; k++) {
    firsts.push((await fitted(page, { preset: "quick", gaussians: "9000" })).first);
    memory.push(await ask(page, "memory"));
  }
  report("first pictures of further fits after, s", JSON.stringify(firsts), "memory after each, MiB", JSON.stringify(memory.map((bytes) => bytes / 2 ** 20)));
  await page.close();
}

/** A Kodak-sized image on WebGPU, which without a GPU is SwiftShader. */
async function gpuFit() {
  const { page } = await opened(address("wgpu"));
  const fit = await fitted(page, { preset: "quick", gaussians: "9000" });
  const native = await nativeFit(page);
  report("load", load(), "with WebGPU, s", fit.seconds, "dB", fit.psnr, "by the program on the CPU, dB", native.psnr);
  await page.close();
}

async function frames() {
  const biker = path.join(process.env.GS_DATA ?? "../shared/data", "splats/biker.compressed.ply");
  if (!fs.existsSync(biker)) return report("skipped: no test data", biker);
  const { page } = await opened(address("cpu"));
  assert.equal(await drop(page, "biker.ply", fs.readFileSync(biker)), "");
  const { home } = await page.evaluate(() => globalThis.gsPage.view.info);
  const times = [];
  for (let k = 0; k < 20; k++) {
    const position = home.position.map((value, axis) => value + (axis === 0 ? 0.01 * k : 0));
    times.push((await ask(page, "frame", { frame: { width: 640, height: 480, camera: { ...home, position } } })).took);
  }
  times.sort((a, b) => a - b);
  report("load", load(), "biker at 640x480, frames/s by the median", 1000 / times[10], "fastest", 1000 / times[0]);
  await page.close();
}

const all = { size, cpuFit, frames, gpuFit };
for (const name of process.argv[6]?.split(",") ?? Object.keys(all)) await all[name]();
await close();
