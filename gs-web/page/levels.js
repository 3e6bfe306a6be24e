// Reads the levels of detail of a streamed SOG in a worker of its own, coarse ones first and the nearest first:
// fetches chunks, decodes them, and hands over what there is to draw after each.

import { answer, failure } from "./answer.js";

/** Attempts to fetch a file, and the time between them, ms. */
const [ATTEMPTS, BETWEEN] = [3, 1000];

/** Serves requests; `load` makes an instance of the engine's module, and gives its class `Levels`. */
export function serveLevels(load) {
  let levels;
  let address;
  /** The frame to begin with next. */
  let next;
  let reading = false;
  let hasShown = false;
  /** Chunks on their way, and those that can't be had. */
  const coming = new Map();
  const absent = new Set();
  /** Called when the one that draws has taken what was handed over. */
  let taken;

  const requests = {
    async open({ bytes, address: from, budget, room, module }) {
      address = from;
      const Levels = await load(module);
      levels = new Levels(new Uint8Array(bytes), budget, room);
      return JSON.parse(levels.info());
    },

    look({ frame }) {
      next = frame;
      if (!reading) read();
    },
  };

  self.onmessage = ({ data }) => {
    if (data.taken) return taken?.();
    answer(data, requests);
  };

  async function read() {
    reading = true;
    try {
      while (next) await readFor(next);
    } catch (error) {
      postMessage({ event: "failure", ...(await failure(error)) });
    }
    reading = false;
  }

  /** Reads what a frame needs, until there is a newer one. */
  async function readFor(frame) {
    next = undefined;
    levels.look(JSON.stringify(frame));
    do {
      for (;;) {
        const missing = levels.missing().filter((path) => !absent.has(path));
        for (const path of coming.keys()) if (!missing.includes(path)) coming.delete(path);
        if (missing.length === 0) break;
        await take(missing);
        await show(false);
        if (next) return;
      }
      await show(false);
    } while (!next && levels.next());
    if (!next) postMessage({ event: "levels", complete: true });
  }

  /**
   * Waits for the first of the chunks that are missing, and takes it; the next one comes while it is decoded. One
   * that can't be had is left out.
   */
  async function take([path, after]) {
    try {
      const files = await begun(path);
      // Nothing delays the first picture.
      if (after && hasShown) begun(after).catch(() => {});
      levels.add(path, [...files.keys()], [...files.values()]);
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError) throw error;
      absent.add(path);
      postMessage({ event: "failure", ...(await failure(error)) });
    }
    coming.delete(path);
  }

  /** The files of a chunk, which are fetched once. */
  function begun(path) {
    if (!coming.has(path)) coming.set(path, fetched(path));
    return coming.get(path);
  }

  /** Hands over what there is, if that has changed, and waits until it is taken. */
  async function show(complete) {
    const numbers = levels.shown();
    if (!numbers) return;
    hasShown = true;
    const { shDegree, antialias } = levels;
    const done = new Promise((resolve) => (taken = resolve));
    postMessage({ event: "levels", numbers, shDegree, antialias, complete }, [numbers.buffer]);
    await done;
  }

  /** The files of a chunk by name: its `meta.json`, and the images that it names. */
  async function fetched(path) {
    const at = new URL(path, address);
    const meta = await bytesOf(at);
    const parts = Object.values(JSON.parse(new TextDecoder().decode(meta)));
    const names = parts.flatMap((part) => part?.files ?? []);
    const images = await Promise.all(names.map((name) => bytesOf(new URL(name, at))));
    return new Map([[path.split("/").pop(), meta], ...names.map((name, k) => [name, images[k]])]);
  }
}

async function bytesOf(url) {
  for (let attempt = 1; ; attempt++) {
    let response;
    try {
      response = await fetch(url);
      if (response.ok) return new Uint8Array(await response.arrayBuffer());
    } catch (error) {
      if (attempt === ATTEMPTS) throw new Error(`${url}: ${error.message}`);
    }
    // Only what is wrong with the server may be better later.
    if (response && (response.status < 500 || attempt === ATTEMPTS)) {
      throw new Error(`${url}: the server answers ${response.status} ${response.statusText}`.trim());
    }
    await new Promise((resolve) => setTimeout(resolve, BETWEEN));
  }
}
