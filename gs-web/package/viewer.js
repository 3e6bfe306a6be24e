// Shows scenes of Gaussians: the class Viewer, and the element <gs-viewer>. viewer.d.ts says what each
// part takes and gives. A worker computes, with WebGPU where the browser has it.

import { Connection } from "./engine.js";
import { Stage } from "./stage.js";

/** A viewer in an element of the page, whose size it takes. */
export class Viewer {
  /** What the last scene is, once it is open. */
  info;
  /** The backend that computes, and why. */
  engine;
  #place;
  #options;
  #canvas;
  #worker;
  #opening;
  #stage;
  /** Opens what is open again, if the engine has to be started anew. */
  #source;
  #loads = 0;
  #resized = new ResizeObserver(() => this.#stage.draw());

  constructor(place, options = {}) {
    this.#place = place;
    this.#options = options;
    this.#stage = new Stage({ size: () => this.#size(), draw: (frame) => this.#drawn(frame) });
    this.#start(options.backend ?? "fastest");
    this.#resized.observe(place);
  }

  /** Opens a scene. Of several calls, the last one counts. */
  async load(source, { name, signal, progress, camera } = {}) {
    const load = ++this.#loads;
    const stale = () => load !== this.#loads;
    const bytes = await bytesOf(source, { signal, progress });
    if (stale()) throw abandoned();
    const called = name ?? nameOf(source);
    const info = await this.#open(bytes, called, stale);
    this.#source = { bytes, called };
    if (camera && info.home) info.home = { ...info.home, ...camera };
    await this.#stage.show(info);
    return info;
  }

  async #open(bytes, name, stale = () => false) {
    this.engine = await this.#opening;
    // A copy stays here, so that the scene can be opened again.
    const info = await this.#worker.ask("show", { bytes, name });
    if (stale()) throw abandoned();
    this.info = info;
    return info;
  }

  /** The camera of a 3D scene; another one can be set. */
  get camera() {
    return this.#stage.orbit.pose;
  }

  set camera(camera) {
    this.#stage.orbit.start({ ...this.camera, ...camera });
  }

  /** Takes the first camera again. */
  reset() {
    this.#stage.orbit.restart();
  }

  set background(color) {
    this.#options.background = color;
    this.#stage.draw();
  }

  /** A PNG of what is shown, `[columns, rows]` px. */
  async snapshot(size = this.#size()) {
    if (!this.info) throw new Error("no scene is open");
    return this.#worker.ask("png", { frame: this.#colored(this.#stage.frame(size)) });
  }

  /** Ends the worker and removes the canvas. */
  dispose() {
    this.#loads++;
    this.#resized.disconnect();
    this.#worker.close("the viewer was disposed of");
    this.#canvas.remove();
  }

  #start(wanted) {
    this.#worker?.close();
    const canvas = document.createElement("canvas");
    Object.assign(canvas.style, { display: "block", width: "100%", height: "100%", touchAction: "none" });
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", this.#options.label ?? "A 3D scene. Drag or press arrow keys to turn it.");
    this.#canvas?.remove();
    this.#canvas = this.#place.appendChild(canvas);
    if (this.#options.controls !== false) this.#stage.orbit.attach(canvas);
    // Bundlers find the worker by this form.
    const worker = new Worker(new URL("./viewer-worker.js", import.meta.url), { type: "module" });
    this.#worker = new Connection(worker, (event) => this.#failed(event));
    const target = canvas.transferControlToOffscreen();
    this.#opening = this.#worker.ask("open", { wanted, target }, [target]);
    this.#opening.then(() => (this.#worker.opened = true), () => {});
  }

  /** Goes on without the GPU after the engine has stopped, or says that it can't. */
  async #failed({ error }) {
    const source = this.#source;
    if (this.engine?.backend !== "wgpu" || !source) return this.#options.onerror?.(new Error(error));
    try {
      this.#start("cpu");
      this.engine = undefined;
      await this.#stage.show(await this.#open(source.bytes, source.called), true);
    } catch (error) {
      this.#options.onerror?.(error);
    }
  }

  /** Columns and rows of the picture, px. */
  #size() {
    const ratio = Math.min(2, devicePixelRatio || 1);
    return [this.#canvas.clientWidth, this.#canvas.clientHeight].map((side) => Math.round(side * ratio));
  }

  #colored(frame) {
    const { background } = this.#options;
    return background ? { ...frame, background } : frame;
  }

  async #drawn(frame) {
    try {
      const { took } = await this.#worker.ask("frame", { frame: this.#colored(frame) });
      this.#options.ondraw?.({ width: frame.width, height: frame.height, took });
      return took;
    } catch (error) {
      if (error.fatal) this.#failed({ error: error.message });
      return undefined;
    }
  }
}

const abandoned = () => new DOMException("another scene was asked for", "AbortError");

/** The bytes of an address, a file, or an array. */
async function bytesOf(source, { signal, progress }) {
  if (source instanceof ArrayBuffer) return source;
  if (ArrayBuffer.isView(source)) return new Uint8Array(source.buffer, source.byteOffset, source.byteLength);
  if (source instanceof Blob) return source.arrayBuffer();
  const response = await fetch(source, { signal });
  if (!response.ok) throw new Error(`${source}: the server answers ${response.status} ${response.statusText}`.trim());
  const total = Number(response.headers.get("content-length")) || undefined;
  if (!progress || !response.body) return response.arrayBuffer();
  const parts = [];
  let loaded = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    loaded += value.length;
    progress({ loaded, total });
  }
  return new Blob(parts).arrayBuffer();
}

/** The file name of a source: its ending says the format where the content doesn't. */
function nameOf(source) {
  if (source instanceof Blob) return source.name ?? "scene";
  if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return "scene";
  return decodeURIComponent(new URL(source, location.href).pathname.split("/").pop()) || "scene";
}

const STYLE = `
:host { display: block; position: relative; aspect-ratio: 3 / 2; overflow: hidden; }
:host([hidden]) { display: none; }
#place, #poster { position: absolute; inset: 0; }
#poster { width: 100%; height: 100%; object-fit: contain; pointer-events: none; }
canvas:focus-visible { outline: 2px solid Highlight; outline-offset: -2px; }
`;

/** On a server, which has no elements, the package can be imported all the same. */
const Base = typeof HTMLElement === "undefined" ? class {} : HTMLElement;

/** <gs-viewer src="scene.sog">. */
export class GsViewerElement extends Base {
  static observedAttributes = ["src", "poster", "background", "camera", "fov", "alt"];
  #viewer;
  #root;
  #abort;

  constructor() {
    super();
    this.#root = this.attachShadow({ mode: "open" });
    this.#root.innerHTML = `<style>${STYLE}</style><div id="place"></div><slot hidden></slot>`;
  }

  /** The viewer, while the element is in the page and has a source. */
  get viewer() {
    return this.#viewer;
  }

  get src() {
    return this.getAttribute("src") ?? "";
  }

  set src(value) {
    this.setAttribute("src", value);
  }

  connectedCallback() {
    this.#poster();
    this.#load();
  }

  disconnectedCallback() {
    // An element that is only moved is back in the page by then.
    queueMicrotask(() => this.isConnected || this.#close());
  }

  attributeChangedCallback(name, before, after) {
    if (!this.isConnected || before === after) return;
    if (name === "src") this.#load();
    else if (name === "poster") this.#poster();
    else if (!this.#viewer) return;
    else if (name === "background") this.#viewer.background = colorOf(after);
    else if (name === "alt") this.#root.querySelector("canvas")?.setAttribute("aria-label", after ?? "");
    else if (this.#viewer.info) this.#viewer.camera = this.#camera() ?? {};
  }

  async #load() {
    this.#abort?.abort();
    if (!this.src) return this.#close();
    const { signal } = (this.#abort = new AbortController());
    try {
      this.#viewer ??= new Viewer(this.#root.getElementById("place"), {
        backend: this.getAttribute("backend") ?? undefined,
        background: colorOf(this.getAttribute("background")),
        controls: this.getAttribute("controls") !== "none",
        label: this.getAttribute("alt") ?? undefined,
        onerror: (error) => this.#fail(error),
      });
      const progress = (detail) => this.#tell("progress", detail);
      const info = await this.#viewer.load(this.src, { signal, progress, camera: this.#camera() });
      if (signal.aborted) return;
      this.#root.querySelector("slot").hidden = true;
      this.#root.getElementById("poster")?.remove();
      this.#tell("load", info);
    } catch (error) {
      if (!signal.aborted) this.#fail(error);
    }
  }

  /** What is inside the element is shown instead. */
  #fail(error) {
    this.#close();
    this.#root.getElementById("poster")?.remove();
    this.#root.querySelector("slot").hidden = false;
    this.#tell("error", { error, message: error?.message ?? String(error) });
  }

  #close() {
    this.#abort?.abort();
    this.#viewer?.dispose();
    this.#viewer = undefined;
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  #poster() {
    const source = this.getAttribute("poster");
    const before = this.#root.getElementById("poster");
    if (!source || this.#viewer?.info) return before?.remove();
    const poster = before ?? this.#root.appendChild(document.createElement("img"));
    Object.assign(poster, { id: "poster", src: source, alt: "" });
  }

  /** The camera of the attributes: `camera="x y z, x y z"` (from, to), `fov="50"`. */
  #camera() {
    const camera = {};
    const numbers = (this.getAttribute("camera") ?? "").split(/[\s,]+/).filter(Boolean).map(Number);
    if (numbers.length === 6 && numbers.every(Number.isFinite)) {
      Object.assign(camera, { position: numbers.slice(0, 3), target: numbers.slice(3) });
    } else if (numbers.length > 0) {
      console.warn(`<gs-viewer>: camera="${this.getAttribute("camera")}" is not six numbers, as in "0 0 -3, 0 0 0"`);
    }
    const fov = Number(this.getAttribute("fov"));
    if (fov > 0 && fov < 180) camera.fov = fov;
    return Object.keys(camera).length > 0 ? camera : undefined;
  }
}

/** Red, green and blue, 0 to 1, of a colour of CSS; none for no colour or one that is not known. */
function colorOf(text) {
  if (!text || !CSS.supports("color", text)) return undefined;
  const context = new OffscreenCanvas(1, 1).getContext("2d");
  context.fillStyle = text;
  context.fillRect(0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data.slice(0, 3)].map((byte) => byte / 255);
}

if (typeof customElements !== "undefined" && !customElements.get("gs-viewer")) {
  customElements.define("gs-viewer", GsViewerElement);
}
