// Measures the page in headless Chromium: its size, a fit without WebGPU against the program, how long
// the main thread is blocked, memory, the frames of a large scene, and a large file.
//
// node gs-web/benches/page.mjs chromium target/page target/release/gs target/web-test, after
// cargo xtask web, cargo build --release and cargo xtask web --test --install.

import assert from "node:assert/strict";
import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import zlib from "node:zlib";
import { address, ask, close, drop, fitted, hasThreads, nativeFit, opened, pageFolder, report, status } from "../tests/browser.mjs";

const load = () => os.loadavg()[0];

/** This target is smooth: two SIMD levels of the program end up to 0.11 dB apart at 48 dB, by rounding. */
const NOISE_DB = 0.25;

/** Bytes of a folder's files, compressed by brotli. */
function compressed(folder) {
  const names = fs.readdirSync(folder).filter((name) => /\.(html|js|css|wasm)$/.test(name) && !/one-file|inside/.test(name));
  return names.reduce((sum, name) => sum + zlib.brotliCompressSync(fs.readFileSync(path.join(folder, name))).length, 0);
}

function size() {
  const bytes = compressed(pageFolder);
  const threads = hasThreads ? compressed(path.join(pageFolder, "threads")) : 0;
  report("the page compressed by brotli, bytes", bytes, "its engine with threads", threads);
  assert.ok(bytes < 1_500_000 && bytes + threads < 2_500_000);
}

/** Has the page note for how long its main thread is blocked, ms, from 50 ms on. */
const watchMainThread = (page) =>
  page.evaluate(() => {
    globalThis.tasks = [];
    new PerformanceObserver((list) => globalThis.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask" });
  });

async function cpuFit() {
  const { page } = await opened(address("cpu"));
  await watchMainThread(page);
  const fit = await fitted(page, { preset: "standard", gaussians: "9000" });
  const tasks = await page.evaluate(() => globalThis.tasks);
  const native = await nativeFit(page);
  report("load", load(), "fit, s", fit.seconds, "by the program, s", native.seconds, "ratio", fit.seconds / native.seconds, "dB", fit.psnr, native.psnr);
  report("first picture after, s", fit.first, "main thread blocked for more than 50 ms, ms", JSON.stringify(tasks));
  assert.ok(Math.abs(fit.psnr - native.psnr) < NOISE_DB);
  const firsts = [];
  const memory = [await ask(page, "memory")];
  for (let k = 0; k < 4; k++) {
    firsts.push((await fitted(page, { preset: "quick", gaussians: "9000" })).first);
    memory.push(await ask(page, "memory"));
  }
  report("first pictures of further fits after, s", JSON.stringify(firsts), "memory after each, MiB", JSON.stringify(memory.map((bytes) => bytes / 2 ** 20)));
  await page.close();
}

/** The same with two threads, against the program with two, at its fastest SIMD level and at its lowest. */
async function threadsFit() {
  if (!hasThreads) return report("skipped: the page was built without threads");
  const { page } = await opened(address("cpu", 2));
  report(await status(page));
  for (let k = 0; k < 3; k++) {
    const fit = await fitted(page, { preset: "standard", gaussians: "9000" });
    const fastest = await nativeFit(page, ["--threads", "2"]);
    const baseline = await nativeFit(page, ["--threads", "2", "--simd", "baseline"]);
    const ratios = [fastest, baseline].map(({ seconds }) => fit.seconds / seconds);
    report("load", load(), "fit with two threads, s", fit.seconds, "by the program, s", fastest.seconds, "at its baseline, s", baseline.seconds, "ratios", JSON.stringify(ratios), "dB", fit.psnr, fastest.psnr);
  }
  report("memory, MiB", (await ask(page, "memory")) / 2 ** 20);
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

async function frames(threads) {
  const biker = path.join(process.env.GS_DATA ?? "../shared/data", "splats/biker.compressed.ply");
  if (!fs.existsSync(biker)) return report("skipped: no test data", biker);
  const { page } = await opened(address("cpu", threads));
  assert.equal(await drop(page, "biker.ply", fs.readFileSync(biker)), "");
  const { home } = await page.evaluate(() => globalThis.gsPage.view.info);
  const times = [];
  for (let k = 0; k < 20; k++) {
    const position = home.position.map((value, axis) => value + (axis === 0 ? 0.01 * k : 0));
    times.push((await ask(page, "frame", { frame: { width: 640, height: 480, camera: { ...home, position } } })).took);
  }
  times.sort((a, b) => a - b);
  report("load", load(), "threads", threads ?? 1, "biker at 640x480, frames/s by the median", 1000 / times[10], "fastest", 1000 / times[0]);
  await page.close();
}

const threadsFrames = () => hasThreads && frames(2);

/** A PLY of 104 MB: the page stays responsive while it is opened. */
async function largeFile() {
  const { page } = await opened(address("cpu"));
  const names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
  await page.evaluate((names) => {
    const count = 1_530_000;
    const header = ["ply", "format binary_little_endian 1.0", `element vertex ${count}`, ...names.map((name) => `property float ${name}`), "end_header\n"];
    const values = new Float32Array(count * names.length);
    for (let i = 0; i < count; i++) {
      const place = [Math.sin(i), Math.sin(1.7 * i), Math.sin(2.3 * i)];
      values.set([...place, 0, 0, 0, ...place, 0, -6, -6, -6, 1, 0, 0, 0], i * names.length);
    }
    globalThis.large = new File([header.join("\n"), values], "large.ply");
  }, names);
  await watchMainThread(page);
  const started = performance.now();
  await page.evaluate(async () => {
    const transfer = new DataTransfer();
    transfer.items.add(globalThis.large);
    window.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
    await globalThis.gsPage.opening;
  });
  const seconds = (performance.now() - started) / 1000;
  const { gaussians, bytes, tasks } = await page.evaluate(() => ({ gaussians: globalThis.gsPage.view.info.gaussians, bytes: globalThis.large.size, tasks: globalThis.tasks }));
  report("load", load(), "a file of bytes", bytes, "Gaussians", gaussians, "open after, s", seconds);
  report("main thread blocked for more than 50 ms, ms", JSON.stringify(tasks), "memory, MiB", (await ask(page, "memory")) / 2 ** 20);
  await page.close();
}

const all = { size, cpuFit, threadsFit, frames: () => frames(), threadsFrames, largeFile, gpuFit };
for (const name of process.argv[6]?.split(",") ?? Object.keys(all)) await all[name]();
await close();
