// What goes wrong: each time, the page says what happened, keeps what there was, and lives on.

import assert from "node:assert/strict";
import fs from "node:fs";
import { address, ask, at, caption, choose, drop, fitted, give, launch, makeScene, opened, problem, reached, report, stepOf } from "./browser.mjs";
import { picture } from "./fit.mjs";
import { black } from "./png.mjs";

const wait = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const SMALL = { name: "picture.png", bytes: picture(128, 128) };

/** Starts a fit that takes long enough to be interrupted. */
async function begun(page, image = SMALL) {
  await choose(page, { preset: "best", gaussians: "200" });
  await give(page, image.name, image.bytes, "image/png");
  await reached(page, 1);
}

export const tests = {
  async "files that are broken or of no known format are refused"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("good.ply"));
    const good = fs.readFileSync(at("good.ply"));
    assert.equal(await drop(page, "good.ply", good), "");
    const broken = { "short.ply": good.subarray(0, good.length / 2), "junk.spz": Buffer.from("no scene"), "empty.sog": Buffer.alloc(0), "notes.txt": Buffer.from("hello"), "film.mp4": Buffer.from([0, 0, 0, 24, 102, 116, 121, 112]) };
    for (const [name, bytes] of Object.entries(broken)) {
      const said = await drop(page, name, bytes);
      assert.ok(said.includes(name), `${name}: ${said}`);
      report(said);
      assert.match(await page.$eval("#view-words", (element) => element.textContent), /400 Gaussians|stays open/);
    }
    const image = await drop(page, "broken.png", Buffer.from("\x89PNG no picture"), "image/png");
    assert.match(image, /broken.png is no image that this browser reads/);
    assert.equal(await drop(page, "good.ply", good), "");
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "an image of 20,000 x 20,000 px is refused before it is decoded"() {
    const { page, complaints } = await opened(address("cpu"));
    const bytes = black(20_000, 20_000);
    const started = Date.now();
    const said = await drop(page, "huge.png", bytes, "image/png");
    report(`${bytes.length} bytes, refused after ${Date.now() - started} ms: ${said}`);
    assert.match(said, /huge.png has 20,000×20,000 px, more than the 100 million/);
    // A large one that can be read is scaled, and the page says so.
    await choose(page, { preset: "quick", gaussians: "200" });
    await give(page, "large.png", black(6000, 1000), "image/png");
    await reached(page, 1);
    assert.match(await page.$eval("#status", (element) => element.textContent), /6,000×1,000 px; it is fitted at 2048×341 px/);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "without WebGPU the CPU computes, and the page says why"() {
    const within = await launch("--disable-gpu", "--disable-features=WebGPU,WebGPUService");
    try {
      const { page, complaints } = await opened(address("fastest"), { within });
      const status = await page.$eval("#status", (element) => element.textContent);
      report(status);
      assert.equal(await page.evaluate(() => document.body.dataset.backend), "cpu");
      assert.match(status, /the CPU.*this browser offers no WebGPU/);
      await page.select("#backend", "wgpu");
      await page.waitForFunction(() => !document.getElementById("problem").hidden, { timeout: 60_000 });
      const said = await problem(page);
      report(said);
      assert.match(said, /the CPU computes instead/);
      await fitted(page, { image: SMALL, preset: "quick", gaussians: "100" });
      assert.deepEqual(complaints, []);
    } finally {
      await within.close();
    }
  },

  async "after the loss of a device, the fit goes on on the CPU"() {
    const { page, complaints } = await opened(address("wgpu"));
    makeScene(at("good.ply"));
    assert.equal(await drop(page, "good.ply", fs.readFileSync(at("good.ply"))), "");
    const [worker] = page.workers();
    await worker.evaluate(() => {
      const create = GPUDevice.prototype.createBuffer;
      GPUDevice.prototype.createBuffer = function (...words) {
        globalThis.device = this;
        return create.apply(this, words);
      };
    });
    await begun(page);
    await page.waitForFunction(() => globalThis.gsPage.fit.kept, { timeout: 120_000 });
    const kept = await stepOf(page);
    await worker.evaluate(() => globalThis.device.destroy());
    await page.waitForFunction(() => !document.getElementById("problem").hidden, { timeout: 60_000 });
    const said = await problem(page);
    report(said);
    assert.match(said, /device was lost.*starts again on the CPU, and goes on/);
    await page.waitForFunction(() => document.body.dataset.backend === "cpu" && /Goes on|Step/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 60_000 });
    await reached(page, kept);
    // The scene is open again, too.
    const frames = await page.evaluate(() => Number(document.body.dataset.frames ?? 0));
    await page.click("#tab-view");
    await page.waitForFunction((before) => Number(document.body.dataset.frames) > before, { timeout: 60_000 }, frames);
    await page.click("#tab-fit");
    await page.waitForFunction(() => /Step (\d+) of \1:/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 300_000 });
    const restored = Number(/([\d.]+) dB/.exec(await caption(page))[1]);
    const { psnr } = await fitted(page, { image: SMALL, preset: "best", gaussians: "200" });
    report("dB after the loss", restored, "without one", psnr);
    assert.ok(Math.abs(restored - psnr) < 0.5, `${restored} dB, without a loss ${psnr}`);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "where an engine stops on the CPU, the fit waits at its last checkpoint"() {
    const { page } = await opened(address("cpu"));
    await begun(page);
    await page.waitForFunction(() => globalThis.gsPage.fit.kept, { timeout: 120_000 });
    // As a trap of the WebAssembly in a computation.
    await page.workers()[0].evaluate(() => void setTimeout(() => {
      throw new WebAssembly.RuntimeError("unreachable");
    }));
    await page.waitForFunction(() => /Goes on/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 60_000 });
    assert.match(await problem(page), /starts again on the CPU, paused/);
    const at = await stepOf(page);
    await page.click("#pause");
    await reached(page, at + 1);
    await page.close();
  },

  async "with a full storage nothing is missing, as the page stores nothing"() {
    const { page, complaints } = await opened(address("cpu"), {
      before: () => {
        const full = () => {
          throw new DOMException("the storage is full", "QuotaExceededError");
        };
        Storage.prototype.setItem = full;
        IDBFactory.prototype.open = full;
        if (globalThis.CacheStorage) CacheStorage.prototype.open = full;
      },
    });
    await fitted(page, { image: SMALL, preset: "quick", gaussians: "100" });
    await page.click("#theme");
    assert.deepEqual(await page.evaluate(async () => [localStorage.length, sessionStorage.length, document.cookie, (await indexedDB.databases()).length]), [0, 0, "", 0]);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "in a hidden tab the fit goes on, and reports do not pile up"() {
    const { page, complaints } = await opened(address("cpu"));
    await page.evaluate(() => {
      const { fit } = globalThis.gsPage;
      globalThis.events = 0;
      fit.event = function (...words) {
        globalThis.events += 1;
        return Object.getPrototypeOf(fit).event.apply(fit, words);
      };
    });
    await begun(page, { name: "picture.png", bytes: picture(768, 512) });
    const other = await page.browser().newPage();
    await other.bringToFront();
    const hidden = await page.evaluate(() => document.visibilityState);
    const before = await stepOf(page);
    await wait(2500);
    const after = await stepOf(page);
    report(`the tab is ${hidden}: step ${before}, and ${after} after 2.5 s`);
    assert.equal(hidden, "hidden");
    assert.ok(after > before, `still at step ${after}`);
    // A page that does not run at all, as in a tab that the browser has frozen, is told of all steps
    // at once afterwards.
    const events = await page.evaluate(() => {
      const until = performance.now() + 2000;
      const before = globalThis.events;
      while (performance.now() < until);
      return new Promise((resolve) => setTimeout(() => resolve(globalThis.events - before), 0));
    });
    report(`${events} messages after 2 s without the main thread`);
    assert.ok(events <= 4, `${events} messages`);
    await reached(page, after + 1);
    await page.bringToFront();
    await other.close();
    await page.click("#pause");
    await ask(page, "memory");
    assert.equal(await page.evaluate(() => globalThis.gsPage.fit.steps), await stepOf(page), "the curve has all steps");
    assert.deepEqual(complaints, []);
    await page.close();
  },
};
