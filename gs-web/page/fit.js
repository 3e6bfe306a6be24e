// The panel that fits images.

import { drawCurves } from "./curve.js";
import { download } from "./download.js";

const $ = (id) => document.getElementById(id);

/** The longest side of an image that is fitted, px; larger ones are scaled, and the page says so. */
const MOST_PX = 2048;

export class FitPanel {
  #page;
  #source = { target: "scene" };
  #curves = {};
  #done = {};
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

  /** The engine is there. */
  ready(policies) {
    for (const [list, first] of [["policy-a", ["", "as the preset"]], ["policy-b", ["none", "nothing"]]]) {
      const chosen = $(list).value;
      const options = [first, ...policies.map(({ name, summary }) => [name, name, summary])];
      $(list).replaceChildren(...options.map(([value, text, title]) => Object.assign(new Option(text, value), { title: title ?? "" })));
      $(list).value = chosen;
    }
    $("start").disabled = false;
    this.#set(false);
    this.#enable(false);
  }

  /** Takes an image file as the source, and starts. */
  async open(file) {
    let bitmap;
    try {
      bitmap = await createImageBitmap(file, { colorSpaceConversion: "none", premultiplyAlpha: "none" });
    } catch {
      throw new Error(`${file.name} is no image that this browser reads, or too large for it; save it as a PNG of at most ${MOST_PX} px`);
    }
    const longest = Math.max(bitmap.width, bitmap.height);
    if (longest > MOST_PX) {
      const [resizeWidth, resizeHeight] = [bitmap.width, bitmap.height].map((side) => Math.max(1, Math.round((side * MOST_PX) / longest)));
      this.#page.say(`${file.name} is ${bitmap.width}×${bitmap.height} px; it is fitted at ${resizeWidth}×${resizeHeight} px`);
      const scaled = await createImageBitmap(bitmap, { resizeWidth, resizeHeight, resizeQuality: "high" });
      bitmap.close();
      bitmap = scaled;
    }
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
    $("rounds").replaceChildren();
    [this.#curves, this.#done] = [{}, {}];
    await this.#page.ask("stop", { slot: "b" });
    for (const slot of slots) {
      const policy = policies[slot];
      const { width, height } = await this.#page.ask("start", { slot, source: this.#source, choices: { ...choices, policy } });
      this.#curves[slot] = [];
      this.#words(slot, `${width}×${height} px, policy ${policy ?? "of the preset"}`);
    }
    this.#enable(true);
    this.#run(true);
  }

  /** A running fit has made steps, or failed. */
  event({ event, slot, report, error, fatal }) {
    if (event === "failure") {
      this.#set(false);
      return this.#page.fail(Object.assign(new Error(error), { fatal }));
    }
    this.#show(slot, report);
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
    this.#curves[slot].push(...report.curve);
    this.#done[slot] = report.finished;
    const [, count, loss, estimate] = this.#curves[slot].at(-1) ?? [0, report.count, NaN, null];
    const psnr = report.psnr ?? estimate;
    const quality = psnr === null ? `loss ${loss.toExponential(2)}` : `${psnr.toFixed(2)} dB`;
    const words = `Step ${report.step} of ${report.iterations}: ${report.count ?? count} Gaussians, ${quality}, ${report.seconds.toFixed(1)} s, ${(report.memory / 2 ** 20).toFixed(0)} MiB`;
    this.#words(slot, words);
    $("curve-words").textContent = words;
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
