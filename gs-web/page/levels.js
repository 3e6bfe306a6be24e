// Reads the levels of detail of a streamed SOG in a worker of its own, coarse levels and near chunks first: fetches
// chunks, decodes them, and after each hands over all that can be drawn.

import { answer, failure } from "./answer.js";

/** Attempts to fetch a file, and the time between them, ms. */
const [ATTEMPTS, BETWEEN] = [3, 1000];
/** The most images of a chunk. */
const MOST_IMAGES = 16;

/** Serves requests; `load` makes an instance of the engine's module, and gives its class `Levels`. */
export function serveLevels(load) {
  let levels;
  let address;
  /** What to look at next, and what to call when there is such a thing. */
  let next;
  let hurry = () => {};
  let reading = false;
  let hasShown = false;
  /** Chunks on their way: `{ files, abort }`; and those that could not be fetched, with whether that may change. */
  const coming = new Map();
  const absent = new Map();
  /** Called when the one that draws has taken what was handed over. */
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
   * Waits for the first of the chunks that are missing, or for a newer camera, and takes the chunk. The next chunk is
   * fetched while it is decoded. A chunk that could not be fetched is left out.
   */
  async function take([path, after], newer) {
    try {
      const files = await Promise.race([begun(path).files, newer]);
      if (!files) return;
      // Nothing delays the first picture.
      if (after && hasShown) begun(after);
      levels.add(path, [...files.keys()], [...files.values()]);
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError) throw error;
      absent.set(path, Boolean(error.mayChange));
      postMessage({ event: "failure", ...(await failure(error)) });
    }
    coming.delete(path);
  }

  /** A chunk on its way, which is fetched once. */
  function begun(path) {
    if (!coming.has(path)) {
      const abort = new AbortController();
      const files = filesOf(path, address, abort.signal);
      files.catch(() => {});
      coming.set(path, { files, abort });
    }
    return coming.get(path);
  }

  /** Hands over what can be drawn, if that has changed, and waits until it is taken. */
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

/** The files of a chunk by name: its `meta.json`, and the images beside it that it names. */
async function filesOf(path, address, signal) {
  const meta = new URL(path.split("/").map(encodeURIComponent).join("/"), address);
  const folder = new URL(".", address).href;
  if (!meta.href.startsWith(folder)) throw new Error(`${path}: is not in the folder of lod-meta.json`);
  const bytes = await bytesOf(meta, signal);
  const names = namesIn(bytes, meta);
  const images = await Promise.all(names.map((name) => bytesOf(new URL(encodeURIComponent(name), meta), signal)));
  return new Map([[path.split("/").pop(), bytes], ...names.map((name, k) => [name, images[k]])]);
}

/** The names of the images of a SOG: a file in another folder is not fetched. */
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

/** The content of a file. What is wrong with the network or the server may be better a little later. */
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
