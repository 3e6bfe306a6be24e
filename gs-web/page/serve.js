// What `gs serve` adds: a list of scenes and runs, and the curves and the newest scene of a run while
// it goes on.

import { Curve, drawCurves } from "./curve.js";

const $ = (id) => document.getElementById(id);

/** Time between two looks at a run, ms. */
const EVERY = 2000;

/** The address of a file in the folder that is served. */
const addressOf = (path) => `serve/file/${path.split("/").map(encodeURIComponent).join("/")}`;

/** Shows the list if the page is served by the program, which marks it. */
export async function watchServer(page, view, found) {
  if (!document.querySelector("meta[name=gs-serve]")) return;
  const list = $("served-list");
  let shown = {};
  let filled;

  async function entries() {
    const response = await fetch("serve/list");
    if (!response.ok) throw new Error(await response.text());
    return response.json();
  }

  function fill(all) {
    const names = JSON.stringify(all.map(({ path, kind }) => [path, kind]));
    // An open list would close.
    if (names === filled) return;
    filled = names;
    const chosen = list.value;
    const option = ({ path, kind }) => new Option(kind === "run" ? `${path || "."} (run)` : path, `${kind} ${path}`);
    list.replaceChildren(new Option("choose…", ""), ...all.map(option));
    list.value = chosen;
  }

  async function update(again) {
    const all = await entries();
    fill(all);
    const entry = all.find(({ path, kind }) => `${kind} ${path}` === list.value);
    $("run").hidden = entry?.kind !== "run";
    if (!entry) return;
    if (entry.kind === "run" && entry.modified !== shown.modified) await drawRun(entry);
    const scene = entry.kind === "run" ? entry.scene : entry.path;
    const modified = entry.kind === "run" ? entry.scene_modified : entry.modified;
    if (scene && (scene !== shown.scene || modified !== shown.sceneModified)) {
      const before = shown.scene;
      shown = { ...shown, scene, sceneModified: modified };
      // The newest scene of a run may be another file than before.
      await view.fetched(addressOf(scene), again && before !== undefined);
    }
    shown.modified = entry.modified;
  }

  async function drawRun({ path, table }) {
    const response = await fetch(addressOf(table));
    const [head, ...rows] = (await response.text()).trim().split("\n").map((line) => line.split(","));
    const column = (names) => head.findIndex((name) => names.includes(name));
    const [step, count, loss, psnr] = [["step"], ["count", "gaussians"], ["loss"], ["psnr"]].map(column);
    const number = (row, at) => (at < 0 || row[at] === undefined || row[at] === "" ? null : Number(row[at]));
    const curve = rows.map((row) => [step, count, loss, psnr].map((at) => number(row, at)));
    drawCurves($("run-curve"), { a: new Curve().add(curve) }, getComputedStyle(document.body).color);
    const last = curve.at(-1);
    $("run-words").textContent = last ? `${path || "."}: step ${last[0]}, ${last[1]} Gaussians, loss ${last[2]}` : `${path}: no step yet`;
  }

  list.addEventListener("change", () => {
    shown = {};
    update(false).catch(page.fail);
  });
  $("served").hidden = false;
  fill(await entries());
  found();
  for (;;) {
    await new Promise((resolve) => setTimeout(resolve, EVERY));
    if (document.hidden) continue;
    // The program may be restarted, or a file may be replaced in this moment.
    await update(true).catch((error) => page.say(`The server does not answer: ${error.message}`));
  }
}
