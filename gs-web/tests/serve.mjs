// `gs serve` with a fit that goes on: its curve and its newest scene appear, and change.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import fs from "node:fs";
import { once } from "node:events";
import { createInterface } from "node:readline";
import { at, hasThreads, opened, program, report, status } from "./browser.mjs";
import { picture } from "./fit.mjs";

export const tests = {
  async "a fit that goes on is shown by gs serve"() {
    const folder = at("served");
    fs.mkdirSync(folder);
    fs.writeFileSync(at("served.png"), picture(256, 256));
    const server = spawn(program, ["serve", folder, "--port", "0"], { stdio: ["ignore", "pipe", "inherit"] });
    const [line] = await once(createInterface({ input: server.stdout }), "line");
    const words = ["fit", at("served.png"), "-n", "500", "-i", "100000", "--checkpoint-every", "20", "--threads", "1", "--backend", "cpu", "-o", `${folder}/run`];
    const fit = spawn(program, words, { stdio: "ignore" });
    try {
      const { page, complaints } = await opened(`${line.split(" ")[0]}?backend=cpu`);
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
