// The panel that shows scenes.

import { download } from "./download.js";
import { Orbit } from "./orbit.js";

const $ = (id) => document.getElementById(id);

/** The longest time of a frame while the camera moves, ms; slower pictures get coarser. */
const MOVING_MS = 120;
/** Time after the last movement until the picture is drawn at full size, ms. */
const REST_MS = 250;

export class ViewPanel {
  #page;
  #orbit;
  info;
  /** Opens again what is open. */
  #source;
  #name = "scene";
  #busy = false;
  #again = false;
  #coarse = 1;
  #rest = 0;
  /** The rectangle of a 2D scene, px of its image. */
  #rectangle;

  constructor(page) {
    this.#page = page;
    this.#orbit = new Orbit(() => this.#moved());
    this.#orbit.attach($("canvas-view"));
    for (const id of ["order", "antialias", "degree"]) $(id).addEventListener("change", () => this.draw());
    $("home").addEventListener("click", () => this.#orbit.restart());
    $("shot").addEventListener("click", () => this.#shot());
    $("save-sog").addEventListener("click", () => this.#saveSog());
    new ResizeObserver(() => this.draw()).observe($("stage"));
  }

  /** The engine is there; the scene that another had open is opened again, with its camera. */
  async ready() {
    if (!this.info) return;
    this.info = undefined;
    await this.#source(true);
  }

  /** A new canvas has taken the place of the old one. */
  moved(canvas) {
    if (canvas.id === "canvas-view") this.#orbit.attach(canvas);
  }

  async open(file) {
    await this.#show(file.name, () => file.arrayBuffer());
  }

  /** Opens the scene inside a page of one file, if there is one. */
  async openEmbedded(found) {
    const element = $("embedded-scene");
    if (!element) return;
    found();
    const address = () => `data:application/octet-stream;base64,${element.textContent.trim()}`;
    await this.#show(element.dataset.name, async () => (await fetch(address())).arrayBuffer()).catch(() => {});
  }

  /** Shows the scene that `read` reads; with `again`, the camera stays where it is. */
  async #show(name, read, again = false) {
    this.#words(`Reading ${name}…`);
    const bytes = await read();
    this.#words(`Reading ${name}, ${(bytes.byteLength / 1e6).toFixed(1)} MB…`);
    try {
      this.info = await this.#page.ask("openScene", { bytes, name }, [bytes]);
    } catch (error) {
      this.#words(this.info ? "The scene before it stays open." : "No scene is open.");
      throw Object.assign(error, { shown: true });
    }
    this.#name = name.replace(/\.[^.]*$/, "");
    this.#source = (again) => this.#show(name, read, again);
    const { kind, size, home, shDegree } = this.info;
    this.#rectangle = kind === "2d" ? [0, 0, ...size] : undefined;
    $("degree").replaceChildren(new Option("all", ""), ...Array.from({ length: shDegree }, (_, k) => new Option(k, k)));
    for (const id of ["order", "antialias", "degree"]) $(id).disabled = kind === "2d";
    $("save-sog").disabled = kind === "2d";
    $("shot").disabled = false;
    this.#coarse = 1;
    if (home && !again) this.#orbit.start(home);
    await this.draw();
  }

  /** What is drawn at this size. */
  frame(width, height) {
    const frame = { width, height };
    if (this.#rectangle) {
      // The whole image, with its sides in proportion.
      const [, , columns, rows] = this.#rectangle;
      const scale = Math.max(columns / width, rows / height);
      frame.rectangle = [(columns - width * scale) / 2, (rows - height * scale) / 2, width * scale, height * scale];
      return frame;
    }
    frame.camera = this.#orbit.pose;
    if ($("order").value) frame.order = $("order").value;
    if ($("antialias").value) frame.antialias = $("antialias").value;
    if ($("degree").value) frame.shDegree = Number($("degree").value);
    return frame;
  }

  #size(divisor) {
    const canvas = $("canvas-view");
    const ratio = Math.min(2, devicePixelRatio || 1) / divisor;
    return [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
  }

  #moved() {
    clearTimeout(this.#rest);
    this.#rest = setTimeout(() => this.draw(), REST_MS);
    this.draw(true);
  }

  /** Draws the scene; one picture at a time, and the last view always. */
  async draw(moving = false) {
    if (!this.info || $("view").hidden) return;
    if (this.#busy) {
      this.#again = true;
      return;
    }
    this.#busy = true;
    try {
      const [width, height] = this.#size(moving ? this.#coarse : 1);
      const { took } = await this.#page.ask("frame", { frame: this.frame(width, height) });
      if (moving && took > MOVING_MS && this.#coarse < 8) this.#coarse *= 1.5;
      else if (moving && took < MOVING_MS / 4 && this.#coarse > 1) this.#coarse = Math.max(1, this.#coarse / 1.5);
      const { format, gaussians, losses } = this.info;
      const lost = losses?.length ? `; ${losses.join("; ")}` : "";
      this.#words(`${format}, ${gaussians.toLocaleString("en")} Gaussians, ${width}×${height} px in ${took.toFixed(0)} ms${lost}`);
      document.body.dataset.frames = Number(document.body.dataset.frames ?? 0) + 1;
    } catch {
      this.#again = false;
    } finally {
      this.#busy = false;
    }
    if (this.#again) {
      this.#again = false;
      this.draw(true);
    }
  }

  async #shot() {
    const [width, height] = this.#size(1);
    download(await this.#page.ask("viewPng", { frame: this.frame(width, height) }), `${this.#name}.png`);
  }

  async #saveSog() {
    this.#words("Writing a SOG…");
    const bytes = await this.#page.ask("sceneFile", { name: "scene.sog" });
    download(bytes, `${this.#name}.sog`);
    this.#words(`The SOG has ${bytes.length} bytes.`);
  }

  #words(text) {
    $("view-words").textContent = text;
  }

  /** Opens the scene of an address; a scene that was open before keeps its camera if `again`. */
  async fetched(path, again = false) {
    const read = async () => {
      const response = await fetch(`serve/file/${path.split("/").map(encodeURIComponent).join("/")}`);
      if (!response.ok) throw new Error(`${path}: ${await response.text()}`);
      return response.arrayBuffer();
    };
    await this.#show(path.split("/").pop(), read, again);
  }
}
