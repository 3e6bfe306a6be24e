// The panel that shows scenes.

import { download } from "./download.js";
import { directionOf, homeWith } from "./orbit.js";
import { Stage } from "./stage.js";

const $ = (id) => document.getElementById(id);

export class ViewPanel {
  #page;
  #stage = new Stage({ size: () => this.#size(), draw: (frame, full) => this.#drawn(frame, full) });
  /** Opens again what is open. */
  #source;
  #name = "scene";
  /** The last picture: its frame, the time that it took, ms, and what it shows. */
  #picture;

  constructor(page) {
    this.#page = page;
    this.#stage.orbit.attach($("canvas-view"));
    for (const id of ["order", "antialias", "degree"]) $(id).addEventListener("change", () => this.draw());
    $("home").addEventListener("click", () => this.#stage.orbit.restart());
    $("shot").addEventListener("click", () => this.#shot());
    $("save-sog").addEventListener("click", () => this.#saveSog());
    new ResizeObserver(() => this.draw()).observe($("stage"));
  }

  /** The engine is there; the scene that another had open is opened again, with its camera. */
  async ready() {
    if (!this.#stage.info) return;
    this.#stage.info = undefined;
    await this.#source(true);
  }

  /** A new canvas has taken the place of the old one. */
  moved(canvas) {
    if (canvas.id === "canvas-view") this.#stage.orbit.attach(canvas);
  }

  async open(file) {
    await this.#show(file.name, async () => ({ bytes: await file.arrayBuffer() }));
  }

  /** Opens the scene inside a page of one file, if there is one. */
  async openEmbedded(found) {
    const element = $("embedded-scene");
    if (!element) return;
    found();
    const address = () => `data:application/octet-stream;base64,${element.textContent.trim()}`;
    const read = async () => ({ bytes: await (await fetch(address())).arrayBuffer() });
    await this.#show(element.dataset.name, read).catch(() => {});
  }

  /** Shows the scene that `read` reads; with `again`, the camera stays where it is. */
  async #show(name, read, again = false) {
    this.#words(`Reading ${name}…`);
    const { bytes, address } = await read();
    this.#words(`Reading ${name}, ${(bytes.byteLength / 1e6).toFixed(1)} MB…`);
    let info;
    try {
      info = await this.#page.ask("openScene", { bytes, name, address }, [bytes]);
    } catch (error) {
      this.#words(this.#stage.info ? "The scene before it stays open." : "No scene is open.");
      throw Object.assign(error, { shown: true });
    }
    this.#name = name.replace(/\.[^.]*$/, "");
    this.#source = (again) => this.#show(name, read, again);
    const { kind, shDegree } = info;
    $("degree").replaceChildren(new Option("all", ""), ...Array.from({ length: shDegree }, (_, k) => new Option(k, k)));
    for (const id of ["order", "antialias", "degree"]) $(id).disabled = kind === "2d";
    $("save-sog").disabled = kind === "2d" || Boolean(info.streamed);
    $("shot").disabled = false;
    this.#picture = undefined;
    const up = directionOf(new URLSearchParams(location.search).get("up"));
    if (up && info.home) info.home = homeWith(info.home, up);
    await this.#stage.show(info, again);
  }

  /** Handles an event of a streamed scene: more can be drawn, all is there, or a part could not be fetched. */
  async levels({ error, fatal, complete, isNew }) {
    if (error) return this.#page.fail(Object.assign(new Error(error), { fatal }));
    if (isNew) return this.#stage.changed().catch(() => {});
    if (!complete || !(await this.#stage.rested()) || !this.#picture) return;
    this.#picture.complete = true;
    this.#describe();
  }

  /** Says what the picture shows, and how long it took. */
  #describe() {
    if (!this.#picture) return;
    const { frame, took, gaussians: drawn, complete } = this.#picture;
    const { format, gaussians, losses, streamed } = this.#stage.info;
    const number = (count) => count.toLocaleString("en");
    const count = streamed ? `${number(drawn)} of ${number(gaussians)}` : number(gaussians);
    const size = `${frame.width}×${frame.height} px`;
    const coming = complete ? "" : "; finer levels are being fetched";
    const lost = losses?.length ? `; ${losses.join("; ")}` : "";
    this.#words(`${format}, ${count} Gaussians, ${size} in ${took.toFixed(0)} ms${coming}${lost}`);
  }

  /** Draws the scene. */
  draw() {
    return this.#stage.draw();
  }

  /** What is drawn, with the choices of the page. */
  #chosen(frame) {
    if (!frame.camera) return frame;
    const chosen = { ...frame };
    if ($("order").value) chosen.order = $("order").value;
    if ($("antialias").value) chosen.antialias = $("antialias").value;
    if ($("degree").value) chosen.shDegree = Number($("degree").value);
    return chosen;
  }

  #size() {
    if ($("view").hidden) return [0, 0];
    const canvas = $("canvas-view");
    const ratio = Math.min(2, devicePixelRatio || 1);
    return [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
  }

  /** Draws a frame, and says how long it took. */
  async #drawn(frame, full) {
    try {
      const answer = await this.#page.ask("frame", { frame: this.#chosen(frame), full });
      const { took } = answer;
      this.#picture = { frame, ...answer };
      this.#describe();
      document.body.dataset.frames = Number(document.body.dataset.frames ?? 0) + 1;
      return took;
    } catch {
      return undefined;
    }
  }

  async #shot() {
    const frame = this.#chosen(this.#stage.frame(this.#stage.size()));
    download(await this.#page.ask("viewPng", { frame }), `${this.#name}.png`);
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

  /** Opens the scene at an address. With `again`, the camera stays where it is. */
  async fetched(address, again = false) {
    const read = async () => {
      const response = await fetch(address);
      if (!response.ok) throw new Error(`${address}: ${(await response.text()).slice(0, 200) || response.status}`);
      return { bytes: await response.arrayBuffer(), address: response.url };
    };
    await this.#show(nameOf(address), read, again);
  }
}

/** The file name of an address. */
function nameOf(address) {
  const name = new URL(address, location.href).pathname.split("/").pop();
  try {
    return decodeURIComponent(name);
  } catch {
    return name; // a percent sign that escapes nothing
  }
}
