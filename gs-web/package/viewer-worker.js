// The worker of a viewer: it holds the engine and draws into the viewer's canvas. Requests are answered in
// order, one at a time.

import { answer } from "./answer.js";
import init, { Engine } from "./gs_viewer.js";

let engine;
let canvas;
/** Scenes that are open, by the viewer's number for them. */
const views = new Map();
let queue = Promise.resolve();

const requests = {
  async open({ wanted, target }) {
    canvas = target;
    await init({ module_or_path: new URL("./gs_viewer_bg.wasm", import.meta.url) });
    engine = await Engine.open(wanted);
    return { backend: engine.name, reason: engine.reason };
  },

  show({ scene, bytes, name }) {
    const view = engine.view(new Uint8Array(bytes), name);
    views.set(scene, view);
    return JSON.parse(view.info());
  },

  close({ scene }) {
    views.get(scene)?.free();
    views.delete(scene);
  },

  async frame({ scene, frame }) {
    const started = performance.now();
    const image = await drawn(scene, frame);
    const took = performance.now() - started;
    put(image, canvas);
    return { took };
  },

  async png({ scene, frame }) {
    const image = await drawn(scene, frame);
    const canvas = new OffscreenCanvas(image.width, image.height);
    put(image, canvas);
    return canvas.convertToBlob({ type: "image/png" });
  },
};

async function drawn(scene, frame) {
  const view = views.get(scene);
  if (!view) throw new Error("the scene is no longer open");
  const pixels = await view.pixels(JSON.stringify(frame));
  return new ImageData(new Uint8ClampedArray(pixels.buffer), frame.width, frame.height);
}

function put(image, canvas) {
  const { width, height } = image;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext("2d").putImageData(image, 0, 0);
}

self.onmessage = ({ data }) => {
  queue = queue.then(() => answer(data, requests, engine));
};
