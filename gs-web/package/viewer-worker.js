// The worker of a viewer: it holds the engine and draws into the viewer's canvas. Requests are answered in
// order, one at a time.

import { answer } from "./answer.js";
import init, { Engine } from "./gs_viewer.js";
import { OpenScene } from "./open-scene.js";

let module;
let engine;
let canvas;
/** Scenes that are open, by the viewer's number for them. */
const scenes = new Map();
let queue = Promise.resolve();

const requests = {
  async open({ wanted, target }) {
    canvas = target;
    const response = await fetch(new URL("./gs_viewer_bg.wasm", import.meta.url));
    module = await WebAssembly.compile(await response.arrayBuffer());
    await init({ module_or_path: module });
    engine = await Engine.open(wanted);
    return { backend: engine.name, reason: engine.reason };
  },

  async show({ scene, ...source }) {
    // Bundlers find the worker by this form.
    const newReader = () => new Worker(new URL("./levels-worker.js", import.meta.url), { type: "module" });
    const changed = (change) => postMessage({ event: "levels", scene, ...change });
    const opened = await OpenScene.of(engine, source, newReader, module, changed);
    scenes.set(scene, opened);
    return opened.info;
  },

  /** Requests the levels that a camera needs, before there is a picture. */
  look({ scene, frame }) {
    scenes.get(scene)?.look(frame, [frame.width, frame.height]);
  },

  close({ scene }) {
    scenes.get(scene)?.free();
    scenes.delete(scene);
  },

  async frame({ scene, frame, full }) {
    const opened = sceneOf(scene);
    if (full) opened.look(frame, full);
    const started = performance.now();
    const image = await drawn(opened, frame);
    const took = performance.now() - started;
    if (image) put(image, canvas);
    const { gaussians, complete } = opened;
    return { isDrawn: Boolean(image), took, gaussians, complete };
  },

  async png({ scene, frame }) {
    const image = await drawn(sceneOf(scene), frame);
    if (!image) throw new Error("nothing of the scene has been fetched yet");
    const canvas = new OffscreenCanvas(image.width, image.height);
    put(image, canvas);
    return canvas.convertToBlob({ type: "image/png" });
  },
};

function sceneOf(scene) {
  const opened = scenes.get(scene);
  if (!opened) throw new Error("the scene is no longer open");
  return opened;
}

async function drawn(opened, frame) {
  const pixels = await opened.pixels(frame);
  return pixels && new ImageData(new Uint8ClampedArray(pixels.buffer), frame.width, frame.height);
}

function put(image, canvas) {
  const { width, height } = image;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext("2d").putImageData(image, 0, 0);
}

self.onmessage = ({ data }) => {
  queue = queue.then(() => answer(data, requests, engine));
};
