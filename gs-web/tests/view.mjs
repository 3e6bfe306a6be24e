// Scenes in the page: all formats are drawn as the program draws them, and the camera moves.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { address, ask, at, drop, fitted, makeScene, opened, place, psnr, report, run, screenshots } from "./browser.mjs";
import { picture } from "./fit.mjs";

/** Opens a file of the tests in a page, and compares what is drawn with what the program draws. */
async function compare(page, name, [width, height], least, ...size) {
  assert.equal(await drop(page, name, fs.readFileSync(at(name))), "", name);
  run("render", at(name), "-o", at(`${name}.png`), "--backend", "cpu", ...size);
  const found = psnr(await ask(page, "viewPixels", { frame: { width, height } }), fs.readFileSync(at(`${name}.png`)));
  assert.ok(found > least, `${name}: ${found} dB against gs render`);
}

export const tests = {
  async "scenes of all formats are drawn as the program draws them"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("made.ply"));
    const transform = path.join(path.resolve(place), "node_modules/@playcanvas/splat-transform/bin/cli.mjs");
    execFileSync(process.execPath, [transform, "-w", at("made.ply"), at("made.compressed.ply")], { stdio: "pipe" });
    for (const name of ["made.ply", "made.compressed.ply", "made.splat", "made.spz", "made-3.spz", "made.sog", "made.gltf", "made.glb"]) {
      if (!name.endsWith("ply")) run("convert", at("made.ply"), at(name), ...(name === "made-3.spz" ? ["--spz-version", "3"] : []));
      await compare(page, name, [320, 240], 55, "--size", "320x240");
    }
    const sog = await ask(page, "sceneFile", { name: "again.sog" });
    fs.writeFileSync(at("again.sog"), sog);
    assert.match(run("info", at("again.sog")), /SOG/);
    await screenshots(page, "view");
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "with WebGPU, scenes are drawn as on the CPU with all effects"() {
    const { page, complaints } = await opened(address("wgpu"));
    makeScene(at("made.ply"));
    await compare(page, "made.ply", [320, 240], 50, "--size", "320x240");
    for (const [order, antialias] of [["global", "none"], ["per-pixel", "dilate"], ["global", "mip"], ["per-pixel", "compensated"]]) {
      run("render", at("made.ply"), "-o", at("effects.png"), "--size", "160x120", "--backend", "cpu", "--order", order, "--antialias", antialias);
      const pixels = await ask(page, "viewPixels", { frame: { width: 160, height: 120, order, antialias } });
      const found = psnr(pixels, fs.readFileSync(at("effects.png")));
      report(`${order}, ${antialias}, dB`, found);
      assert.ok(found > 50, `${order}, ${antialias}: ${found} dB against gs render`);
    }
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "a compact image and a 2D scene are drawn"() {
    const { page, complaints } = await opened(address("cpu"));
    await fitted(page, { image: { name: "picture.png", bytes: picture(160, 120) }, preset: "quick", gaussians: "300" });
    for (const [kind, name] of [["scene", "a.gs2d.safetensors"], ["gsi", "a.gsi"]]) {
      fs.writeFileSync(at(name), await ask(page, "fitFile", { slot: "a", kind }));
      await compare(page, name, [160, 120], 50);
    }
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "keys and pointers move the camera"() {
    const { page, complaints } = await opened(address("cpu"));
    makeScene(at("good.ply"));
    assert.equal(await drop(page, "good.ply", fs.readFileSync(at("good.ply"))), "");
    const frames = () => page.evaluate(() => Number(document.body.dataset.frames ?? 0));
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
    await moved(() => page.touchscreen.touchStart(box.x + 50, box.y + 50).then(async () => {
      await page.touchscreen.touchMove(box.x + 120, box.y + 60);
      await page.touchscreen.touchEnd();
    }));
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

  async "controls have names, keys reach the tabs, and the theme changes"() {
    const { page } = await opened(address("cpu"));
    const unnamed = await page.$$eval("button, select, input:not([hidden]), canvas", (elements) =>
      elements.filter((element) => !(element.textContent.trim() || element.labels?.length || element.getAttribute("aria-label"))).map((element) => element.id));
    assert.deepEqual(unnamed, []);
    await page.focus("#tab-fit");
    await page.keyboard.press("ArrowRight");
    assert.deepEqual(await page.evaluate(() => [document.activeElement.id, document.getElementById("view").hidden, document.getElementById("fit").hidden]), ["tab-view", false, true]);
    const color = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    const before = await color();
    await page.click("#theme");
    assert.notEqual(await color(), before);
    await page.setViewport({ width: 360, height: 640 });
    for (const tab of ["#tab-fit", "#tab-view"]) {
      await page.click(tab);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= 360), "no sideways scrolling at 360 px");
    }
    await page.close();
  },
};
