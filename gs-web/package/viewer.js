// Shows scenes of Gaussians: the class Viewer, and the element <gs-viewer>. viewer.d.ts says what each
// part takes and gives. A worker computes, with WebGPU where the browser has it.

import { Connection } from "./engine.js";
import { directionOf, homeWith } from "./orbit.js";
import { Stage, frameOf } from "./stage.js";

/** A viewer in an element of the page, whose size it takes. */
export class Viewer {
  /** The backend that computes, and why. */
  engine;
  #place;
  #options;
  #canvas;
  #stage;
  /** The backend to start with. */
  #wanted;
  /** The connection to the worker, and a promise of it, which is fulfilled when its engine is open. */
  #worker;
  #opening;
  /** Done when the worker has answered what it was asked last. */
  #turn = Promise.resolve();
  #loads = 0;
  /**
   * The scene that is open: `{ id, bytes, name, address, info, worker, camera }`, where `worker` is the one that has
   * it. While the first levels of a scene with levels of detail are being fetched, it has `begun`, which ends the wait.
   */
  #scene;
  /** The scene whose first levels are being fetched, and a function that abandons it. */
  #loading;
  #abandon;
  /** The last picture that `ondraw` was called with. */
  #drawnLast;
  /** The scene on the stage: that one, or one whose first picture is being drawn. */
  #staged;
  #resized = new ResizeObserver(() => this.#stage.draw());

  constructor(place, options = {}) {
    this.#place = place;
    this.#options = { ...options };
    this.#wanted = options.backend ?? "fastest";
    this.#stage = new Stage({ size: () => this.#size(), draw: (frame, full) => this.#drawn(frame, full) });
    const canvas = document.createElement("canvas");
    Object.assign(canvas.style, { display: "block", width: "100%", height: "100%", touchAction: "none" });
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", options.label ?? "A 3D scene. Drag or press arrow keys to turn it.");
    this.#canvas = place.appendChild(canvas);
    this.#opening = this.#open(this.#wanted);
    // The first scene tries again, and says what is wrong.
    this.#opening.catch(() => {});
    this.#resized.observe(place);
  }

  /** What the open scene is. */
  get info() {
    return this.#scene?.info;
  }

  /** Opens a scene. Of several calls, the last one counts. */
  async load(source, { name, signal, progress, camera } = {}) {
    const scene = { id: ++this.#loads, maxGaussians: this.#options.maxGaussians };
    this.#abandon?.();
    const isLast = () => scene.id === this.#loads;
    try {
      Object.assign(scene, await contentOf(source, { signal, progress }));
      signal?.throwIfAborted();
      scene.name = name ?? nameOf(source);
      if (isLast()) await this.#ask(scene);
      if (isLast()) {
        const { home } = scene.info;
        if (home) scene.info.home = { ...(camera?.up && !camera.position ? homeWith(home, camera.up) : home), ...camera };
        if (scene.info.streamed) await this.#begin(scene, signal);
      }
      if (isLast()) await this.#show(scene);
      if (!isLast()) throw abandoned();
    } catch (error) {
      // What was open before stays open.
      this.#close(scene);
      if (this.#staged === scene) this.#show(this.#scene);
      throw isLast() || signal?.aborted ? error : abandoned();
    }
    this.#close(this.#scene);
    this.#scene = scene;
    return scene.info;
  }

  /** The camera of a 3D scene; another one can be set. */
  get camera() {
    return this.#stage.orbit.pose;
  }

  set camera(camera) {
    this.#stage.orbit.look({ ...this.camera, ...camera });
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
    if (!this.#staged) throw new Error("no scene is open");
    return this.#ask(this.#staged, "png", { frame: this.#colored(this.#stage.frame(size)) });
  }

  /** Ends the worker and removes the canvas. */
  dispose() {
    this.#loads++;
    this.#abandon?.();
    this.#scene = undefined;
    this.#show(undefined);
    this.#resized.disconnect();
    this.#worker?.close();
    this.#worker = undefined;
    this.#opening = Promise.reject(new Error("the viewer was disposed of"));
    this.#opening.catch(() => {});
    this.#canvas.remove();
  }

  /** Starts a worker, and gives the connection to it once its engine is open. */
  async #open(wanted) {
    // A canvas can be handed over once only. It takes the place of the other one with its first picture.
    const canvas = this.#canvas.cloneNode();
    if (this.#options.controls !== false) this.#stage.orbit.attach(canvas);
    // Bundlers find the worker by this form.
    const started = new Worker(new URL("./viewer-worker.js", import.meta.url), { type: "module" });
    const worker = new Connection(started, (event) => {
      if (event.event === "levels") this.#changed(worker, event);
      else this.#stopped(worker);
    });
    this.#worker = Object.assign(worker, { canvas });
    try {
      const target = canvas.transferControlToOffscreen();
      this.engine = await worker.ask("open", { wanted, target }, [target]);
      return Object.assign(worker, { opened: true });
    } catch (error) {
      this.#stopped(worker);
      throw error;
    }
  }

  /** Waits until the first levels of a scene have been fetched. */
  async #begin(scene, signal) {
    const begun = new Promise((resolve, reject) => {
      scene.begun = (error) => (error ? reject(error) : resolve());
    });
    const abandon = () => scene.begun?.(signal?.aborted ? signal.reason : abandoned());
    this.#loading = scene;
    this.#abandon = abandon;
    signal?.addEventListener("abort", abandon, { once: true });
    try {
      const size = this.#size().map((side) => Math.max(1, side));
      const frame = frameOf(scene.info.home ?? this.camera, size);
      await Promise.all([begun, this.#ask(scene, "look", { frame })]);
    } finally {
      signal?.removeEventListener("abort", abandon);
      scene.begun = undefined;
      if (this.#loading === scene) this.#loading = this.#abandon = undefined;
    }
  }

  /**
   * Handles an event of a scene: more of it can be drawn, all is there, a part could not be fetched, or the engine
   * stopped.
   */
  #changed(worker, { scene: id, error, fatal, complete, isNew }) {
    const why = error && Object.assign(new Error(error), { fatal });
    const scene = [this.#scene, this.#loading].find((scene) => scene?.id === id);
    const mayTryCpu = fatal && this.engine?.backend === "wgpu";
    if (fatal) this.#stopped(worker);
    if (scene?.begun) {
      if (why || isNew) scene.begun(why);
    } else if (!scene || scene !== this.#staged) {
      return;
    } else if (isNew || mayTryCpu) {
      // An error of this picture closes the scene; otherwise, the event's error no longer matters.
      this.#stage.changed().catch(() => {});
    } else if (why) {
      this.#failed(why);
    } else if (complete) {
      this.#completed(scene);
    }
  }

  /** Calls `ondraw` again if the last picture was not known to be complete when it was drawn, and is. */
  async #completed(scene) {
    const isRested = await this.#stage.rested();
    if (!isRested || scene !== this.#staged || !this.#drawnLast || this.#drawnLast.complete) return;
    this.#drawnLast.complete = true;
    this.#options.ondraw?.({ ...this.#drawnLast });
  }

  /** Reports an error of the open scene. If the engine has stopped, the scene is closed. */
  #failed(error) {
    if (hasStopped(error)) {
      this.#scene = undefined;
      this.#show(undefined);
    }
    this.#options.onerror?.(error);
  }

  /** The worker can't go on. What is asked next starts another one. */
  #stopped(worker) {
    if (worker !== this.#worker) return;
    worker.close();
    // The levels that it was reading will never come.
    this.#loading?.begun?.(Object.assign(new Error("the engine stopped"), { fatal: true }));
    if (this.engine?.backend === "wgpu") this.#wanted = "cpu";
    this.engine = this.#worker = this.#opening = undefined;
  }

  /**
   * Asks the worker about a scene, or only opens it, one thing at a time. If the engine stops, a new one tries it
   * once more, on the CPU.
   */
  #ask(scene, request, rest) {
    const attempt = (wanted) => this.#attempt(wanted, scene, request, rest);
    const answer = this.#turn.then(() =>
      attempt(this.#wanted).catch((error) => {
        if (!hasStopped(error)) throw error;
        return attempt("cpu");
      }));
    this.#turn = answer.catch(() => {});
    return answer;
  }

  async #attempt(wanted, scene, request, rest) {
    const worker = await (this.#opening ??= this.#open(wanted));
    const { id, bytes, name, address, maxGaussians } = scene;
    try {
      if (scene.worker !== worker) {
        // A copy of the bytes stays here, for another worker.
        const info = await worker.ask("show", { scene: id, bytes, name, address, maxGaussians });
        Object.assign(scene, { worker, info: scene.info ?? info });
      }
      return request && (await worker.ask(request, { scene: id, ...rest }));
    } catch (error) {
      if (hasStopped(error)) this.#stopped(worker);
      throw error;
    }
  }

  /** Lets the worker forget a scene. */
  #close(scene) {
    scene?.worker?.ask("close", { scene: scene.id }).catch(() => {});
  }

  /** Puts a scene on the stage, or none. One that was there before gets its camera back. */
  #show(scene) {
    if (this.#staged) this.#staged.camera = this.camera;
    this.#staged = scene;
    if (!scene) return (this.#stage.info = undefined);
    const drawn = this.#stage.show(scene.info);
    if (scene.camera) this.camera = scene.camera;
    return drawn;
  }

  async #drawn(frame, full) {
    const scene = this.#staged;
    try {
      const { isDrawn, ...drawn } = await this.#ask(scene, "frame", { frame: this.#colored(frame), full });
      // A new worker may have nothing of the scene yet.
      if (!isDrawn) return undefined;
      if (this.#canvas !== scene.worker.canvas) this.#replace(scene.worker.canvas);
      this.#drawnLast = { width: frame.width, height: frame.height, ...drawn };
      this.#options.ondraw?.({ ...this.#drawnLast });
      return drawn.took;
    } catch (error) {
      if (hasStopped(error) && scene === this.#scene && scene === this.#staged) this.#failed(error);
      throw error;
    }
  }

  /** Shows the canvas of another worker. */
  #replace(canvas) {
    const hasFocus = this.#canvas.matches(":focus");
    canvas.setAttribute("aria-label", this.#canvas.getAttribute("aria-label"));
    this.#canvas.replaceWith(canvas);
    this.#canvas = canvas;
    if (hasFocus) canvas.focus({ preventScroll: true });
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
}

const abandoned = () => new DOMException("another scene was asked for, or the viewer was disposed of", "AbortError");

/** Whether an error is the end of a worker: its engine has stopped, or it was closed for that reason. */
const hasStopped = ({ fatal, closed }) => Boolean(fatal || closed);

/** The bytes of an address, a file, or an array, and their address if they have one. */
async function contentOf(source, { signal, progress }) {
  if (source instanceof ArrayBuffer) return { bytes: source };
  if (ArrayBuffer.isView(source)) return { bytes: new Uint8Array(source.buffer, source.byteOffset, source.byteLength) };
  if (source instanceof Blob) return { bytes: await source.arrayBuffer() };
  const response = await fetch(source, { signal });
  if (!response.ok) throw new Error(`${source}: the server answers ${response.status} ${response.statusText}`.trim());
  const total = Number(response.headers.get("content-length")) || undefined;
  const address = response.url;
  if (!progress || !response.body) return { bytes: await response.arrayBuffer(), address };
  const parts = [];
  let loaded = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    loaded += value.length;
    progress({ loaded, total });
  }
  return { bytes: await new Blob(parts).arrayBuffer(), address };
}

/** The file name of a source: its ending says the format where the content doesn't. */
function nameOf(source) {
  if (source instanceof Blob) return source.name ?? "scene";
  if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return "scene";
  const name = new URL(source, location.href).pathname.split("/").pop() || "scene";
  try {
    return decodeURIComponent(name);
  } catch {
    return name; // a percent sign that escapes nothing
  }
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
  static observedAttributes = ["src", "poster", "background", "camera", "fov", "up", "alt"];
  #viewer;
  #root;
  #abort;
  /** The source that is shown, or on its way. */
  #asked;

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
    // An element that is moved has its scene, and one that is upgraded has begun with its attributes.
    if (this.src !== this.#asked) this.#load();
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
    this.#asked = this.src;
    try {
      this.#viewer ??= new Viewer(this.#root.getElementById("place"), {
        backend: this.getAttribute("backend") ?? undefined,
        background: colorOf(this.getAttribute("background")),
        controls: this.getAttribute("controls") !== "none",
        label: this.getAttribute("alt") ?? undefined,
        maxGaussians: this.hasAttribute("max-gaussians") ? Number(this.getAttribute("max-gaussians")) : undefined,
        // A scene that is still open stays.
        onerror: (error) => (this.#viewer.info ? this.#tell("error", { error, message: error.message }) : this.#fail(error)),
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
    this.#viewer = this.#asked = undefined;
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  #poster() {
    const source = this.getAttribute("poster");
    const before = this.#root.getElementById("poster");
    if (!source || this.#viewer?.info) return before?.remove();
    const poster = before ?? this.#root.appendChild(document.createElement("img"));
    if (poster.getAttribute("src") !== source) Object.assign(poster, { id: "poster", src: source, alt: "" });
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
    const up = directionOf(this.getAttribute("up"));
    if (up) camera.up = up;
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
