// The worker of a viewer: it holds the engine and draws into the viewer's canvas. Requests are answered in
// order, one at a time.

import init, { Engine } from "./gs_viewer.js";

let engine;
let view;
let canvas;
let queue = Promise.resolve();

const requests = {
  async open({ wanted, target }) {
    canvas = target;
    await init({ module_or_path: new URL("./gs_viewer_bg.wasm", import.meta.url) });
    engine = await Engine.open(wanted);
    return { backend: engine.name, reason: engine.reason };
  },

  show({ bytes, name }) {
    const opened = engine.view(new Uint8Array(bytes), name);
    view?.free();
    view = opened;
    return JSON.parse(view.info());
  },

  async frame({ frame }) {
    const started = performance.now();
    const image = await drawn(frame);
    const took = performance.now() - started;
    put(image, canvas);
    return { took };
  },

  async png({ frame }) {
    const image = await drawn(frame);
    const canvas = new OffscreenCanvas(image.width, image.height);
    put(image, canvas);
    return canvas.convertToBlob({ type: "image/png" });
  },
};

async function drawn(frame) {
  const pixels = await view.pixels(JSON.stringify(frame));
  return new ImageData(new Uint8ClampedArray(pixels.buffer), frame.width, frame.height);
}

function put(image, canvas) {
  const { width, height } = image;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext("2d").putImageData(image, 0, 0);
}

self.onmessage = ({ data }) => {
  queue = queue.then(() => answer(data));
};

async function answer({ id, request, ...rest }) {
  try {
    const result = await requests[request](rest);
    postMessage({ id, result });
  } catch (error) {
    postMessage({ id, error: words(error), fatal: await isFatal(error) });
  }
}

/** Whether the engine can't go on: it has stopped within a computation, or its device is lost. */
async function isFatal(error) {
  if (error instanceof WebAssembly.RuntimeError) return true;
  return engine !== undefined && !(await engine.works().catch(() => false));
}

function words(error) {
  if (error instanceof WebAssembly.RuntimeError) return `the engine stopped: ${error.message}`;
  if (error instanceof RangeError) return "there is not enough memory for this scene";
  return error?.message ?? String(error);
}
