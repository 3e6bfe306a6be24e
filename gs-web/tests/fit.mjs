// Fits in the page: on both backends they end as the program's.

import assert from "node:assert/strict";
import { address, ask, choose, fitted, hasThreads, nativeFit, opened, reached, report, screenshots, stepOf } from "./browser.mjs";
import { encoded } from "./png.mjs";

/**
 * A rough picture, as a PNG. In fits of smooth ones, roundings grow to differences of 1 dB within fifty
 * steps, also between two SIMD levels of the program.
 */
export function picture(width, height) {
  const patch = (x, y, side) => {
    const hash = Math.imul(Math.floor(x / side), 0x27d4eb2d) ^ Math.imul(Math.floor(y / side), 0x165667b1);
    const mixed = Math.imul(hash ^ (hash >>> 15), 0x2c1b3c6d);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 0xffffffff;
  };
  const value = (x, y) => 255 * (0.5 * patch(x, y, 16) + 0.3 * patch(x, y, 5) + 0.2 * patch(x, y, 1));
  return encoded(width, height, (y) =>
    Buffer.from(Array.from({ length: width }, (_, x) => [value(x, y), value(x + 50, y), value(x + 90, y)]).flat()));
}

export const tests = {
  async "a fit on the CPU ends as the program's"() {
    const { page, complaints } = await opened(address("cpu"));
    const image = { name: "picture.png", bytes: picture(768, 512) };
    const fit = await fitted(page, { image, preset: "quick", gaussians: "3000" });
    const native = await nativeFit(page);
    report("fit on the CPU, dB", fit.psnr, "by the program, dB", native.psnr, "first picture after, s", fit.first);
    assert.ok(Math.abs(fit.psnr - native.psnr) < 0.1, `${fit.psnr} dB, natively ${native.psnr}`);
    await fitted(page, { image, preset: "quick", gaussians: "3000" });
    const once = await ask(page, "memory");
    await fitted(page, { image, preset: "quick", gaussians: "3000" });
    const again = await ask(page, "memory");
    assert.ok(again <= once, `${again} bytes after one more fit, ${once} before`);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "a fit with WebGPU ends as the program's"() {
    const { page, complaints } = await opened(address("wgpu", hasThreads ? 2 : undefined));
    assert.equal(await page.evaluate(() => document.body.dataset.backend), "wgpu");
    // Small, because software drivers take minutes for what a GPU does in a second.
    const image = { name: "picture.png", bytes: picture(128, 128) };
    const fit = await fitted(page, { image, preset: "quick", gaussians: "1000" });
    const native = await nativeFit(page);
    report("fit with WebGPU, dB", fit.psnr, "by the program on the CPU, dB", native.psnr);
    assert.ok(Math.abs(fit.psnr - native.psnr) < 0.1, `${fit.psnr} dB, natively ${native.psnr}`);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "two policies side by side, single steps and rounds"() {
    const { page, complaints } = await opened(address("cpu"));
    await choose(page, { preset: "quick", gaussians: "300", policyB: "image-gs" });
    await page.click("#start");
    await Promise.all([reached(page, 50, "a"), reached(page, 50, "b")]);
    const rounds = await page.$$eval("#rounds li", (items) => items.map((item) => item.textContent));
    assert.ok(rounds.some((text) => text.startsWith("left, after step")) && rounds.some((text) => text.startsWith("right")), rounds.join());
    assert.ok(rounds.some((text) => /\d+ added where the error is largest/.test(text)), rounds.join());
    for (const kind of ["ellipses", "error", "target", "picture"]) {
      await page.select("#show", kind);
      await ask(page, "memory");
    }
    await screenshots(page, "fit");
    await choose(page, { preset: "standard", gaussians: "300", policyB: "none" });
    await page.click("#start");
    await reached(page, 1);
    await page.click("#pause");
    await ask(page, "memory");
    const before = await stepOf(page);
    await page.click("#step");
    await reached(page, before + 1);
    assert.equal(await stepOf(page), before + 1);
    const listed = () => page.$$eval("#rounds li", (items) => items.length);
    const rounded = await listed();
    await page.click("#round");
    await page.waitForFunction((before) => document.querySelectorAll("#rounds li").length > before, { timeout: 120_000 }, rounded);
    assert.equal(await listed(), rounded + 1);
    assert.deepEqual(complaints, []);
    await page.close();
  },
};
