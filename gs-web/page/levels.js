// Reads the levels of detail of a streamed SOG, in a worker of its own. It fetches and decodes chunks, coarse levels
// and near chunks first. After each chunk, it sends all that can be drawn to the worker that draws.

import { answer, failure } from "./answer.js";

/** Attempts to fetch a file, and the time between them, ms. */
const [ATTEMPTS, BETWEEN] = [3, 1000];
/** The most images of a chunk. */
const MOST_IMAGES = 16;

/** Answers requests. `load` instantiates the engine's module and returns its class `Levels`. */
export function serveLevels(load) {
  let levels;
  let address;
  /** The camera to read for next, and what to call when there is one. */
  let next;
  let hurry = () => {};
  let reading = false;
  let hasShown = false;
  /** Chunks that are being fetched, `{ files, abort }`; and those that could not be, with whether that may change. */
  const coming = new Map();
  const absent = new Map();
  /** Called when the worker that draws has taken what was sent. */
  let taken;

  const requests = {
    async open({ bytes, address: from, budget, room, module }) {
      address = from;
      const Levels = await load(module);
      levels = new Levels(new Uint8Array(bytes), budget, room);
      return JSON.parse(levels.info());
    },

    look({ frame, look }) {
      next = { frame, look };
      hurry();
      if (!reading) read();
    },
  };

  self.onmessage = ({ data }) => {
    if (data.taken) return taken?.();
    answer(data, requests);
  };

  async function read() {
    reading = true;
    while (next) {
      try {
        await readFor(next);
      } catch (error) {
        const told = await failure(error);
        postMessage({ event: "failure", ...told });
        if (told.fatal) return;
      }
    }
    reading = false;
  }

  /** Reads what a camera needs, until there is a newer one. */
  async function readFor({ frame, look }) {
    next = undefined;
    const newer = new Promise((resolve) => (hurry = resolve));
    for (const [path, mayChange] of absent) if (mayChange) absent.delete(path);
    levels.look(JSON.stringify(frame));
    do {
      for (;;) {
        const missing = levels.missing().filter((path) => !absent.has(path));
        for (const [path, { abort }] of coming) {
          if (missing.includes(path)) continue;
          abort.abort();
          coming.delete(path);
        }
        if (missing.length === 0) break;
        await take(missing, newer);
        if (next) return;
        await show(look);
        if (next) return;
      }
      await show(look);
    } while (!next && levels.next());
    if (!next) postMessage({ event: "levels", complete: true, look });
  }

  /**
   * Waits for the first of the missing chunks, and adds it; returns early if there is a newer camera. While the chunk
   * is decoded, the next one is fetched. A chunk that could not be fetched is left out.
   */
  async function take([path, after], newer) {
    try {
      const files = await Promise.race([begun(path).files, newer]);
      if (!files) return;
      // Before the first picture, one chunk at a time is fetched, so that nothing delays it.
      if (after && hasShown) begun(after);
      levels.add(path, [...files.keys()], [...files.values()]);
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError) throw error;
      absent.set(path, Boolean(error.mayChange));
      postMessage({ event: "failure", ...(await failure(error)) });
    }
    coming.delete(path);
  }

  /** The chunk at this path, which is being fetched; starts that if necessary. */
  function begun(path) {
    if (!coming.has(path)) {
      const abort = new AbortController();
      const files = filesOf(path, address, abort.signal);
      files.catch(() => {});
      coming.set(path, { files, abort });
    }
    return coming.get(path);
  }

  /** Sends what can be drawn, if that has changed, and waits until it is taken. */
  async function show(look) {
    const numbers = levels.shown();
    if (!numbers) return;
    hasShown = true;
    const { shDegree, antialias } = levels;
    const done = new Promise((resolve) => (taken = resolve));
    postMessage({ event: "levels", numbers, shDegree, antialias, look }, [numbers.buffer]);
    await done;
  }
}

/**
 * The files of a chunk by name: its `meta.json`, and the images next to it that it names. Each address has the query of
 * that of `lod-meta.json`, which may be a signature.
 */
async function filesOf(path, address, signal) {
  const { search } = new URL(address);
  const below = (name, place) => Object.assign(new URL(name, place), { search });
  const meta = below(path.split("/").map(encodeURIComponent).join("/"), address);
  const folder = new URL(".", address).href;
  if (!meta.href.startsWith(folder)) throw new Error(`${path}: is not in the folder of lod-meta.json`);
  const bytes = await bytesOf(meta, signal);
  const names = namesIn(bytes, meta);
  const images = await Promise.all(names.map((name) => bytesOf(below(encodeURIComponent(name), meta), signal)));
  return new Map([[path.split("/").pop(), bytes], ...names.map((name, k) => [name, images[k]])]);
}

/** The names of the images of a SOG. Files in other folders are refused. */
function namesIn(bytes, meta) {
  let parts;
  try {
    parts = Object.values(JSON.parse(new TextDecoder().decode(bytes)));
  } catch {
    throw new Error(`${meta}: expected the meta.json of a SOG, found no JSON`);
  }
  const names = [...new Set(parts.flatMap((part) => part?.files ?? []))];
  const isName = (name) => typeof name === "string" && /^[^/\\:\0]+$/.test(name) && name !== "." && name !== "..";
  if (names.length > MOST_IMAGES || !names.every(isName)) {
    throw new Error(`${meta}: expected names of at most ${MOST_IMAGES} images beside it, found others`);
  }
  return names;
}

/** The content of a file. After errors of the network or the server, it is tried again a little later. */
async function bytesOf(url, signal) {
  for (let attempt = 1; ; attempt++) {
    const [bytes, why, mayChange] = await attempted(url, signal);
    if (bytes) return bytes;
    if (!mayChange || attempt === ATTEMPTS || signal.aborted) throw Object.assign(new Error(`${url}: ${why}`), { mayChange });
    await new Promise((resolve) => setTimeout(resolve, BETWEEN));
  }
}

async function attempted(url, signal) {
  try {
    const response = await fetch(url, { signal });
    if (response.ok) return [new Uint8Array(await response.arrayBuffer())];
    const { status, statusText } = response;
    return [undefined, `the server answers ${status} ${statusText}`.trim(), status >= 500 || status === 408 || status === 429];
  } catch (error) {
    return [undefined, error.message, true];
  }
}
