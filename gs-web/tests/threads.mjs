// Several threads, which the engine has on a cross-origin isolated page.

import assert from "node:assert/strict";
import { address, ask, choose, fitted, give, hasThreads, opened, problem, reached, report, status, stepOf } from "./browser.mjs";
import { picture } from "./fit.mjs";

const IMAGE = { name: "picture.png", bytes: picture(384, 256) };
const FIT = { image: IMAGE, preset: "standard", gaussians: "1000" };

/**
 * The first worker that becomes a second thread gets a module whose table of functions is empty, so that
 * the thread traps when it looks for work. The page hears of that when `stop` is called.
 */
function breakThread() {
  const folder = new URL("threads/", location.href);
  const broken = fetch(new URL("gs_web_bg.wasm", folder)).then((response) => response.arrayBuffer()).then((buffer) => {
    const bytes = new Uint8Array(buffer);
    const parts = [bytes.subarray(0, 8)];
    for (let at = 8; at < bytes.length; ) {
      let [size, shift, content] = [0, 0, at + 1];
      do size += (bytes[content] & 127) * 2 ** shift, (shift += 7);
      while (bytes[content++] & 128);
      parts.push(bytes[at] === 9 ? new Uint8Array([9, 1, 0]) : bytes.subarray(at, content + size));
      at = content + size;
    }
    return new Blob(parts).arrayBuffer().then((patched) => WebAssembly.compile(patched));
  });
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    if (!message.module) return post.call(this, message, ...rest);
    Worker.prototype.postMessage = post;
    const { onmessage } = this;
    this.onmessage = (event) => {
      if ("error" in event.data) globalThis.stop = () => onmessage(event);
      else onmessage(event);
    };
    broken.then((module) => post.call(this, { ...message, module }, ...rest));
  };
}

/** The first worker that becomes a second thread gets no module. */
function loseModule() {
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    post.call(this, message.module ? { ...message, module: null } : message, ...rest);
  };
}

const all = {
  async "fits with one and with several threads are equal to the bit"() {
    const scenes = [];
    for (const threads of [1, 3]) {
      const { page, complaints } = await opened(address("cpu", threads));
      assert.match(await status(page), threads === 1 ? /; one thread, as the address/ : /; 3 threads, as the address/);
      const { seconds } = await fitted(page, FIT);
      report("threads", threads, "s", seconds);
      scenes.push(await ask(page, "fitFile", { slot: "a", kind: "scene" }));
      assert.deepEqual(complaints, []);
      await page.close();
    }
    assert.ok(scenes[0].equals(scenes[1]));
  },

  async "with threads, further fits take no more memory"() {
    const { page } = await opened(address("cpu", 2));
    const memory = [];
    for (let k = 0; k < 8; k++) {
      await fitted(page, { ...FIT, preset: "quick" });
      memory.push(await ask(page, "memory"));
    }
    report("MiB after each fit", JSON.stringify(memory.map((bytes) => bytes / 2 ** 20)));
    // Threads take memory in another order each time, which may leave gaps once. What leaks grows with each fit.
    const larger = memory.slice(2).filter((bytes, k) => bytes > memory[k + 1]);
    assert.ok(larger.length <= 1, `${memory}`);
    await page.close();
  },

  async "where a thread stops, the engine starts again, with its threads"() {
    const { page } = await opened(address("cpu", 2), { before: breakThread });
    await page.waitForFunction(() => globalThis.stop, { timeout: 60_000 });
    await choose(page, { preset: "best", gaussians: "200" });
    await give(page, IMAGE.name, IMAGE.bytes, "image/png");
    await page.waitForFunction(() => globalThis.gsPage.fit.kept, { timeout: 120_000 });
    await page.evaluate(() => globalThis.stop());
    const said = await problem(page);
    report(said);
    assert.match(said, /^the engine stopped: .*starts again on the CPU, paused/);
    await page.waitForFunction(() => /Goes on/.test(document.querySelector("#slot-a figcaption").textContent), { timeout: 60_000 });
    assert.match(await status(page), /; 2 threads, as the address/);
    const at = await stepOf(page);
    await page.click("#pause");
    await reached(page, at + 1);
    await page.close();
  },

  async "where a thread does not start, the engine has one"() {
    const { page, complaints } = await opened(address("cpu", 2), { before: loseModule });
    report(await status(page));
    assert.match(await status(page), /; one thread, as others did not start \(.+\)$/);
    await fitted(page, FIT);
    assert.deepEqual(complaints, []);
    await page.close();
  },

  async "where the page is not isolated, the engine has one thread"() {
    const { page, complaints } = await opened(address("cpu"));
    assert.match(await status(page), /; one thread, as this page is not cross-origin isolated$/);
    assert.deepEqual(complaints, []);
    await page.close();
  },
};

if (!hasThreads) report("skipped: threads: the page was built without the component rust-src");
export const tests = hasThreads ? all : {};
