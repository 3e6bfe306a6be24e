// `gs serve` with a fit that goes on: its curve and its newest scene appear, and change.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import fs from "node:fs";
import { once } from "node:events";
import { createInterface } from "node:readline";
import { at, hasThreads, makeScene, opened, problem, program, report, run, status } from "./browser.mjs";
import { picture } from "./fit.mjs";

/** `gs serve` for a folder, and the address that it prints. */
async function served(folder) {
  const server = spawn(program, ["serve", folder, "--port", "0"], { stdio: ["ignore", "pipe", "inherit"] });
  const [line] = await once(createInterface({ input: server.stdout }), "line");
  return { server, home: line.split(" ")[0] };
}

export const tests = {
  async "levels of detail are streamed from gs serve and by an address"() {
    const folder = at("cities");
    makeScene(at("city.ply"), 9000);
    run("convert", at("city.ply"), `${folder}/city/lod-meta.json`);
    const { server, home } = await served(folder);
    try {
      const words = (page) => page.$eval("#view-words", (element) => element.textContent);
      const complete = (page) => page.waitForFunction(
        () => /^streamed SOG, [\d,]+ of 9,000 Gaussians, .* ms$/.test(document.getElementById("view-words").textContent),
        { timeout: 60_000, polling: 100 });
      const { page, complaints } = await opened(`${home}?backend=cpu`);
      await page.waitForSelector("#served-list option[value='scene city/lod-meta.json']", { timeout: 60_000 });
      await page.select("#served-list", "scene city/lod-meta.json");
      await complete(page);
      const far = Number(/([\d,]+) of/.exec(await words(page))[1].replace(",", ""));
      await page.focus("#canvas-view");
      for (let k = 0; k < 20; k++) await page.keyboard.press("+");
      await page.waitForFunction((far) => Number(/([\d,]+) of/.exec(document.getElementById("view-words").textContent)?.[1].replace(",", "")) > far, { timeout: 60_000, polling: 100 }, far);
      report("from afar", far, "and near:", await words(page));
      assert.deepEqual(complaints, []);
      await page.close();
      const other = await opened(`${home}?backend=cpu&scene=serve/file/city/lod-meta.json`);
      await complete(other.page);
      assert.deepEqual(other.complaints, []);
      await other.page.close();
      // A chunk that is not there is named.
      fs.rmSync(`${folder}/city`, { recursive: true });
      run("convert", at("city.ply"), `${folder}/city/lod-meta.json`);
      const chunks = fs.readdirSync(`${folder}/city`).filter((name) => /^\d+_\d+$/.test(name));
      for (const name of chunks) fs.rmSync(`${folder}/city/${name}/quats.webp`);
      const broken = await opened(`${home}?backend=cpu`);
      await broken.page.waitForSelector("#served-list option[value='scene city/lod-meta.json']", { timeout: 60_000 });
      await broken.page.select("#served-list", "scene city/lod-meta.json");
      await broken.page.waitForFunction(() => /quats\.webp: the server answers 404/.test(document.getElementById("problem").textContent), { timeout: 60_000 });
      report(await problem(broken.page));
      await broken.page.close();
    } finally {
      server.kill();
    }
  },

  async "a fit that goes on is shown by gs serve"() {
    const folder = at("served");
    fs.mkdirSync(folder);
    fs.writeFileSync(at("served.png"), picture(256, 256));
    const { server, home } = await served(folder);
    const words = ["fit", at("served.png"), "-n", "500", "-i", "100000", "--checkpoint-every", "20", "--threads", "1", "--backend", "cpu", "-o", `${folder}/run`];
    const fit = spawn(program, words, { stdio: "ignore" });
    try {
      const { page, complaints } = await opened(`${home}?backend=cpu`);
      assert.match(await status(page), hasThreads ? /; (\d+|one) threads?, as this browser offers/ : /; one thread, as/);
      await page.waitForSelector("#served-list option[value='run run']", { timeout: 60_000 });
      await page.select("#served-list", "run run");
      const shown = () => page.evaluate(() => ({
        step: Number(/step (\d+)/.exec(document.getElementById("run-words").textContent)?.[1] ?? 0),
        frames: Number(document.body.dataset.frames ?? 0),
      }));
      const later = ({ step, frames }) => page.waitForFunction(
        (step, frames) => Number(/step (\d+)/.exec(document.getElementById("run-words").textContent)?.[1] ?? 0) > step
          && Number(document.body.dataset.frames ?? 0) > frames,
        { timeout: 60_000, polling: 200 }, step, frames);
      await later({ step: 0, frames: 0 });
      const first = await shown();
      await later(first);
      const second = await shown();
      report("step of the run", first.step, "later", second.step, "pictures", second.frames);
      fit.kill();
      await once(fit, "exit");
      server.kill();
      await page.waitForFunction(() => /server does not answer/.test(document.getElementById("status").textContent), { timeout: 30_000 });
      assert.deepEqual(complaints.filter((text) => !/ERR_CONNECTION_REFUSED/.test(text)), []);
      await page.close();
    } finally {
      fit.kill();
      server.kill();
    }
  },
};
