// The worker of the page: it holds the engine, and draws into canvases that the page has handed
// over, so that the page itself never waits. Requests are answered in order, one at a time. What a
// running fit has to say is collected until the page has taken what was said before.
//
// Further workers may compute in the engine's memory. They are asked to `load` and to `runThread` only.

import { answer, failure } from "./answer.js";
import init, { Engine, memoryBytes, policies, runThread, startThreads } from "./gs_web.js";
import { OpenScene } from "./open-scene.js";
import { builtInTarget } from "./targets.js";

/** How long a running fit makes steps before it reports, ms. */
const SLICE = 60;
/** Least time between two pictures of a running fit, ms. */
const BETWEEN_PICTURES = 200;
/** Least time between two checkpoints of a running fit, from which it goes on if the engine stops, ms. */
const BETWEEN_CHECKPOINTS = 5000;

/** The engine's module. */
let module;
let engine;
/** The scene that is open. */
let scene;
const canvases = {};
/** Fits by slot: { fit, width, height, running, shown, kept }. */
const fits = {};
/** Reports by slot that the page has not been given yet. */
let untold = {};
/** Whether the page still has to take the last reports. */
let pageIsBusy = false;
let show = "picture";
let queue = Promise.resolve();

const requests = {
  /** Loads the module, in new memory or in that of another worker; returns what shares are made of. */
  async load({ wasm, module: given, memory, shares }) {
    module = given ?? (await WebAssembly.compile(wasm));
    const loaded = await init({ module_or_path: module, memory });
    return shares ? { module, memory: loaded.memory } : undefined;
  },

  startThreads({ count }) {
    startThreads(count);
  },

  /** Computes what the engine asks of this thread. It does not return. */
  runThread() {
    runThread();
  },

  async open({ wanted }) {
    engine = await Engine.open(wanted);
    return { name: engine.name, reason: engine.reason, threads: engine.threads, policies: JSON.parse(policies()) };
  },

  /** Takes a canvas, with the picture that was there before. */
  canvas({ slot, canvas, before }) {
    canvases[slot] = canvas;
    if (!before) return;
    resize(canvas, before.width, before.height);
    canvas.getContext("2d").drawImage(before, 0, 0);
  },

  async start({ slot, source, choices, settings }) {
    stop(slot);
    const { pixels: rgba, width, height } = pixelsOf(source);
    const fit = settings
      ? await engine.fitWith(rgba, width, height, settings)
      : await engine.fit(rgba, width, height, JSON.stringify(choices));
    return begun(slot, fit, width, height);
  },

  async resume({ slot, source, checkpoint }) {
    stop(slot);
    const { pixels: rgba, width, height } = pixelsOf(source);
    return begun(slot, engine.resumeFit(rgba, width, height, checkpoint), width, height);
  },

  stop({ slot }) {
    stop(slot);
  },

  run({ slots, running }) {
    for (const slot of slots) if (fits[slot]) fits[slot].running = running;
    if (running) schedule();
  },

  async advance({ slot, until }) {
    const report = await advance(slot, until);
    await draw(slot);
    await keepIfDue(slot, report);
    return report;
  },

  async show({ kind }) {
    show = kind;
    for (const slot of Object.keys(fits)) await draw(slot);
  },

  async fitFile({ slot, kind }) {
    return fits[slot].fit.file(kind);
  },

  async openScene(source) {
    const newReader = () => new Worker(new URL("levels-worker.js", import.meta.url), { type: "module" });
    const changed = (change) => scene === opened && postMessage({ event: "levels", ...change });
    const opened = await OpenScene.of(engine, source, newReader, module, changed);
    scene?.free();
    scene = opened;
    return { ...opened.info, memory: memoryBytes() };
  },

  async frame({ frame, full }) {
    const opened = scene;
    opened.look(frame, full);
    const started = performance.now();
    const pixels = await opened.pixels(frame);
    const took = performance.now() - started;
    if (pixels) put("view", pixels, frame.width, frame.height);
    const { gaussians, complete } = opened;
    return { took, gaussians, complete };
  },

  async viewPixels({ frame }) {
    return scene.pixels(frame);
  },

  async viewPng({ frame }) {
    if (!scene.view) throw new Error("nothing of the scene has been fetched yet");
    return scene.view.png(JSON.stringify(frame));
  },

  sceneFile({ name }) {
    return scene.view.file(name);
  },

  fitPixels({ slot, kind }) {
    return fits[slot].fit.pixels(kind);
  },

  memory() {
    return memoryBytes();
  },
};

self.onmessage = ({ data }) => {
  if (data.taken) {
    pageIsBusy = false;
    return report();
  }
  queue = queue.then(() => answer(data, requests, engine));
};

function stop(slot) {
  fits[slot]?.fit.free();
  delete fits[slot];
  delete untold[slot];
}

async function begun(slot, fit, width, height) {
  fits[slot] = { fit, width, height, running: false, shown: 0, kept: -Infinity };
  await draw(slot);
  return { memory: memoryBytes(), width, height, step: fit.step };
}

function pixelsOf({ bitmap, target }) {
  return bitmap ? rgbaOf(bitmap) : builtInTarget(target);
}

function rgbaOf(bitmap) {
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.fillStyle = "#fff";
  context.fillRect(0, 0, bitmap.width, bitmap.height);
  context.drawImage(bitmap, 0, 0);
  const { data, width, height } = context.getImageData(0, 0, bitmap.width, bitmap.height);
  return { pixels: new Uint8Array(data.buffer), width, height };
}

let scheduled = false;
// Timers are delayed by browsers, more so in tabs that are hidden; messages aren't.
const soon = new MessageChannel();
soon.port1.onmessage = schedule;

/** Lets each running fit make steps for a while, and then those requests that have come in. */
function schedule() {
  if (scheduled) return;
  scheduled = true;
  queue = queue.then(async () => {
    scheduled = false;
    for (const slot of Object.keys(fits).filter((slot) => fits[slot].running)) {
      try {
        await goOn(slot);
      } catch (error) {
        if (fits[slot]) fits[slot].running = false;
        postMessage({ event: "failure", slot, ...(await failure(error, engine)) });
      }
    }
    if (Object.values(fits).some((fit) => fit.running)) soon.port2.postMessage(null);
  });
}

/** Steps of a running fit, and the picture and the checkpoint that are due after them. */
async function goOn(slot) {
  const found = await advance(slot, { time: SLICE });
  const fit = fits[slot];
  if (found.finished) fit.running = false;
  if (found.finished || performance.now() - fit.shown > BETWEEN_PICTURES) await draw(slot);
  await keepIfDue(slot, found);
  const before = untold[slot];
  if (before) {
    found.curve = [...before.curve, ...found.curve];
    found.rounds = [...before.rounds, ...found.rounds];
  }
  untold[slot] = found;
  report();
}

/** Gives the page what it has not been given yet, once it has taken what was given before. */
function report() {
  if (pageIsBusy || Object.keys(untold).length === 0) return;
  pageIsBusy = true;
  postMessage({ event: "progress", reports: untold });
  untold = {};
}

/** Gives the page a checkpoint if it is time for one, and one is possible after this step. */
async function keepIfDue(slot, { finished }) {
  if (!finished && performance.now() - fits[slot].kept < BETWEEN_CHECKPOINTS) return;
  const checkpoint = await fits[slot].fit.checkpoint();
  if (!checkpoint) return;
  fits[slot].kept = performance.now();
  postMessage({ event: "checkpoint", slot, checkpoint }, [checkpoint.buffer]);
}

async function advance(slot, until) {
  const report = JSON.parse(await fits[slot].fit.advance(JSON.stringify(until)));
  report.memory = memoryBytes();
  return report;
}

async function draw(slot) {
  const { fit, width, height } = fits[slot];
  fits[slot].shown = performance.now();
  if (show === "ellipses") return drawEllipses(slot, await fit.ellipses(), width, height);
  put(slot, await fit.pixels(show), width, height);
}

function put(slot, pixels, width, height) {
  const canvas = canvases[slot];
  if (!canvas) return;
  resize(canvas, width, height);
  const data = new Uint8ClampedArray(pixels.buffer, pixels.byteOffset, pixels.length);
  canvas.getContext("2d").putImageData(new ImageData(data, width, height), 0, 0);
}

function drawEllipses(slot, numbers, width, height) {
  const canvas = canvases[slot];
  if (!canvas) return;
  resize(canvas, width, height);
  const context = canvas.getContext("2d");
  context.fillStyle = "#000";
  context.fillRect(0, 0, width, height);
  const byte = (value) => Math.round(255 * Math.min(1, Math.max(0, value)));
  for (let i = 0; i + 8 < numbers.length; i += 9) {
    const [x, y, a, b, angle, red, green, blue, opacity] = numbers.subarray(i, i + 9);
    context.beginPath();
    context.ellipse(x, y, a, b, angle, 0, 2 * Math.PI);
    context.strokeStyle = `rgb(${byte(0.25 + 0.75 * red)} ${byte(0.25 + 0.75 * green)} ${byte(0.25 + 0.75 * blue)})`;
    context.globalAlpha = Math.max(0.15, opacity);
    context.stroke();
  }
  context.globalAlpha = 1;
}

function resize(canvas, width, height) {
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
}
