// The panel that fits images.

import { Curve, drawCurves } from "./curve.js";
import { download } from "./download.js";

const $ = (id) => document.getElementById(id);

/** The longest side of an image that is fitted, px; larger ones are scaled, and the page says so. */
const MOST_PX = 2048;
/** The most pixels of an image that is read at all: they take 4 bytes each until they are scaled. */
const MOST_DECODED_PX = 100e6;

export class FitPanel {
  #page;
  #source = { target: "scene" };
  #curves = {};
  #done = {};
  /** The last checkpoint of each slot, from which another engine goes on. */
  #kept = {};
  #running = false;
  #drawing;
  #name = "picture";

  constructor(page) {
    this.#page = page;
    $("settings").addEventListener("submit", (event) => {
      event.preventDefault();
      this.start().catch(() => {});
    });
    $("pause").addEventListener("click", () => this.#run(!this.#running));
    $("step").addEventListener("click", () => this.#advance({ steps: 1 }));
    $("round").addEventListener("click", () => this.#advance("round"));
    $("show").addEventListener("change", () => this.#ask("show", { kind: $("show").value }));
    $("target").addEventListener("change", () => {
      this.#source = { target: $("target").value };
      this.#name = "picture";
      this.start().catch(() => {});
    });
    for (const button of document.querySelectorAll("[data-file]")) {
      button.addEventListener("click", () => this.#save(button.dataset.file));
    }
    addEventListener("resize", () => this.drawCurves());
  }

  get running() {
    return this.#running;
  }

  /** Number of steps that the curve of the first fit stands for. */
  get steps() {
    return this.#curves.a?.seen ?? 0;
  }

  /** Whether each fit has left a checkpoint. */
  get kept() {
    return Object.keys(this.#curves).length > 0 && Object.keys(this.#curves).every((slot) => this.#kept[slot]);
  }

  /** The engine is there; fits of an engine before it go on where their last checkpoints are. */
  async ready(policies, running) {
    for (const [list, first] of [["policy-a", ["", "as the preset"]], ["policy-b", ["none", "nothing"]]]) {
      const chosen = $(list).value;
      const options = [first, ...policies.map(({ name, summary }) => [name, name, summary])];
      $(list).replaceChildren(...options.map(([value, text, title]) => Object.assign(new Option(text, value), { title: title ?? "" })));
      $(list).value = chosen;
    }
    $("start").disabled = false;
    this.#set(false);
    this.#enable(false);
    const slots = Object.keys(this.#kept);
    if (slots.length === 0) return;
    for (const slot of slots) {
      const { step } = await this.#page.ask("resume", { slot, source: this.#source, checkpoint: this.#kept[slot] });
      this.#curves[slot].cut(step);
      this.#done[slot] = false;
      for (const item of [...$("rounds").children]) {
        if (item.dataset.slot === slot && Number(item.dataset.step) > step) item.remove();
      }
      this.#words(slot, `Goes on at step ${step}`);
    }
    this.drawCurves();
    this.#enable(true);
    this.#run(running);
  }

  /** Takes an image file as the source, and starts. */
  async open(file) {
    const unreadable = (why) => new Error(`${file.name} ${why}; save it as a PNG or JPEG of at most ${MOST_PX} px and open that`);
    const sides = await sidesOf(file).catch(() => undefined);
    if (!sides) throw unreadable("is no image that this browser reads");
    const [written, longest] = [sides.map((side) => side.toLocaleString("en")).join("×"), Math.max(...sides)];
    if (sides[0] * sides[1] > MOST_DECODED_PX) {
      throw unreadable(`has ${written} px, more than the ${MOST_DECODED_PX / 1e6} million that this page reads`);
    }
    const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
    if (longest > MOST_PX) {
      const [resizeWidth, resizeHeight] = sides.map((side) => Math.max(1, Math.round((side * MOST_PX) / longest)));
      Object.assign(options, { resizeWidth, resizeHeight, resizeQuality: "high" });
      this.#page.say(`${file.name} has ${written} px; it is fitted at ${resizeWidth}×${resizeHeight} px`);
    }
    const bitmap = await createImageBitmap(file, options).catch(() => {
      throw unreadable("is damaged, or too large for this browser");
    });
    this.#source = { bitmap };
    this.#name = file.name.replace(/\.[^.]*$/, "");
    await this.start();
  }

  async start() {
    $("problem").hidden = true;
    this.#enable(false);
    const number = (id) => ($(id).value === "" ? undefined : Number($(id).value));
    const choices = {
      preset: $("preset").value,
      gaussians: number("gaussians"),
      blend: $("blend").value || undefined,
      seed: number("seed"),
    };
    const policies = { a: $("policy-a").value || undefined, b: $("policy-b").value };
    const slots = policies.b === "none" ? ["a"] : ["a", "b"];
    $("slot-b").hidden = slots.length === 1;
    $("curve-words").textContent = `Each quantity within its own range${slots.length === 1 ? "" : "; left solid, right dashed"}.`;
    $("rounds").replaceChildren();
    [this.#curves, this.#done, this.#kept] = [{}, {}, {}];
    await this.#page.ask("stop", { slot: "b" });
    for (const slot of slots) {
      const policy = policies[slot];
      const { width, height } = await this.#page.ask("start", { slot, source: this.#source, choices: { ...choices, policy } });
      this.#curves[slot] = new Curve();
      // One of the fit before may have come in since.
      delete this.#kept[slot];
      this.#words(slot, `${width}×${height} px, policy ${policy ?? "of the preset"}`);
    }
    this.#enable(true);
    this.#run(true);
  }

  /** Running fits have made steps, left a checkpoint, or failed. */
  event({ event, reports, slot, checkpoint, error, fatal }, connection) {
    if (event === "failure") {
      if (!fatal) this.#set(false);
      return this.#page.fail(Object.assign(new Error(error), { fatal }));
    }
    if (event === "checkpoint") {
      if (this.#curves[slot]) this.#kept[slot] = checkpoint;
      return;
    }
    for (const [slot, report] of Object.entries(reports)) this.#show(slot, report);
    connection.taken();
  }

  /** Draws the curves, a few times a second at most. */
  drawCurves() {
    this.#drawing ??= setTimeout(() => {
      this.#drawing = undefined;
      drawCurves($("curve"), this.#curves, getComputedStyle(document.body).color);
    }, 250);
  }

  #show(slot, report) {
    if (!this.#curves[slot]) return;
    this.#curves[slot].add(report.curve);
    this.#done[slot] = report.finished;
    const [, count, loss, estimate] = this.#curves[slot].last ?? [0, report.count, NaN, null];
    const psnr = report.psnr ?? estimate;
    const quality = psnr === null ? `loss ${loss.toExponential(2)}` : `${psnr.toFixed(2)} dB`;
    const words = `Step ${report.step} of ${report.iterations}: ${report.count ?? count} Gaussians, ${quality}, ${report.seconds.toFixed(1)} s, ${(report.memory / 2 ** 20).toFixed(0)} MiB`;
    this.#words(slot, words);
    for (const round of report.rounds) this.#addRound(slot, round);
    this.drawCurves();
    if (Object.keys(this.#curves).every((other) => this.#done[other])) this.#set(false, true);
  }

  #addRound(slot, { step, cloned, split, seeded, pruned, restarted }) {
    const parts = [
      [cloned, "cloned where detail is missing"],
      [split, "split because they were too large for it"],
      [seeded, "added where the error is largest"],
      [pruned, "pruned because they contribute least or nothing"],
    ];
    const said = parts.filter(([count]) => count > 0).map(([count, what]) => `${count} ${what}`);
    const item = document.createElement("li");
    Object.assign(item.dataset, { slot, step });
    const side = Object.keys(this.#curves).length > 1 ? { a: "left, ", b: "right, " }[slot] : "";
    item.textContent = `${side}after step ${step}: ${said.join(", ") || "nothing changed"}${restarted ? "; the fit diverged and starts again with smaller steps" : ""}.`;
    $("rounds").append(item);
    $("rounds").scrollTop = $("rounds").scrollHeight;
  }

  #words(slot, text) {
    $(`slot-${slot}`).querySelector("figcaption").textContent = text;
  }

  #run(running) {
    this.#set(running);
    this.#ask("run", { slots: Object.keys(this.#curves), running });
  }

  async #advance(until) {
    this.#run(false);
    for (const slot of Object.keys(this.#curves)) {
      if (this.#done[slot]) continue;
      const report = await this.#ask("advance", { slot, until });
      if (report) this.#show(slot, report);
    }
  }

  #set(running, finished = false) {
    this.#running = running;
    $("pause").textContent = running ? "Pause" : "Go on";
    for (const id of ["pause", "step", "round"]) $(id).disabled = finished;
  }

  #enable(enabled) {
    for (const id of ["pause", "step", "round"]) $(id).disabled = !enabled;
    for (const button of document.querySelectorAll("[data-file]")) button.disabled = !enabled;
  }

  async #save(kind) {
    const names = { scene: "scene.gs2d.safetensors", png: "reconstruction.png", gsi: "picture.gsi", settings: "settings.toml" };
    if (kind === "gsi") this.#page.say("Encoding the picture anew for the compact file…");
    const bytes = await this.#ask("fitFile", { slot: "a", kind });
    if (bytes) download(bytes, `${this.#name}-${names[kind]}`);
    if (kind === "gsi" && bytes) this.#page.say(`The compact file has ${bytes.length} bytes.`);
  }

  /** The page shows a failure. */
  #ask(request, rest) {
    return this.#page.ask(request, rest).catch(() => undefined);
  }
}

/** Columns and rows of an image file. A browser reads them from its header, before it decodes pixels. */
async function sidesOf(file) {
  const image = new Image();
  const address = URL.createObjectURL(file);
  try {
    await new Promise((resolve, reject) => Object.assign(image, { onload: resolve, onerror: reject, src: address }));
    return [image.naturalWidth, image.naturalHeight];
  } finally {
    URL.revokeObjectURL(address);
  }
}
