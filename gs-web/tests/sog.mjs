// Compares SOG and .ksplat as gs reads and writes them with @playcanvas/splat-transform, number by
// number.
//
// node sog.mjs GS PLACE [SCENE.ply]: the program, a folder with node_modules, and a scene; without
// one, a small scene is made.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";

const [gs, place, given] = process.argv.slice(2);
const transform = path.join(path.resolve(place), "node_modules/@playcanvas/splat-transform/bin/cli.mjs");
const files = path.join(path.resolve(place), "sog");
fs.rmSync(files, { recursive: true, force: true });
fs.mkdirSync(files, { recursive: true });
const at = (name) => path.join(files, name);
const ours = (from, to) => execFileSync(gs, ["convert", from, to], { stdio: "pipe" });
const theirs = (from, to) => execFileSync(process.execPath, [transform, "-w", "-g", "cpu", from, to], { stdio: "pipe" });

/** The columns of a binary PLY of floats, by name. */
function columns(file) {
  const bytes = fs.readFileSync(file);
  const end = bytes.indexOf("end_header\n") + "end_header\n".length;
  const header = bytes.toString("latin1", 0, end);
  const count = Number(/element vertex (\d+)/.exec(header)[1]);
  const names = [...header.matchAll(/property float (\w+)/g)].map((match) => match[1]);
  const numbers = new Float32Array(count * names.length);
  for (let k = 0; k < numbers.length; k++) numbers[k] = bytes.readFloatLE(end + 4 * k);
  return Object.fromEntries(names.map((name, column) => [name, Float32Array.from({ length: count }, (_, row) => numbers[row * names.length + column])]));
}

/** The largest difference of each quantity in two scenes of the same Gaussians in the same order. */
function differences(a, b) {
  const [one, other] = [columns(a), columns(b)];
  const quantities = { means: /^[xyz]$/, "log-scales": /^scale_/, colours: /^f_dc_/, SH: /^f_rest_/, opacities: /^opacity$/, rotations: /^rot_/ };
  const norm = (scene, row) => Math.hypot(scene.rot_0[row], scene.rot_1[row], scene.rot_2[row], scene.rot_3[row]);
  const found = {};
  for (const [quantity, pattern] of Object.entries(quantities)) {
    const names = Object.keys(one).filter((name) => pattern.test(name));
    assert.deepEqual(names.filter((name) => !(name in other)), [], `${b} lacks columns`);
    let largest = 0;
    for (let row = 0; row < one.x.length; row++) {
      if (quantity === "rotations") {
        const dot = names.reduce((sum, name) => sum + one[name][row] * other[name][row], 0);
        largest = Math.max(largest, 1 - Math.abs(dot) / (norm(one, row) * norm(other, row)));
        continue;
      }
      for (const name of names) {
        const [x, y] = [one[name][row], other[name][row]];
        const value = quantity === "opacities" ? Math.abs(sigmoid(x) - sigmoid(y)) : Math.abs(x - y) / (quantity === "means" ? 1 + Math.abs(x) : 1);
        largest = Math.max(largest, value);
      }
    }
    found[quantity] = largest;
  }
  return found;
}

const sigmoid = (x) => 1 / (1 + Math.exp(-x));

/** A scene of 400 Gaussians of degree 1, as text. */
function makeScene(file) {
  const rest = Array.from({ length: 9 }, (_, k) => `f_rest_${k}`);
  const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", ...rest, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
  const rows = Array.from({ length: 400 }, (_, i) => names.map((name, k) => (name === "rot_0" ? 1 : (name.startsWith("scale") ? -2 : 0) + Math.sin(1.7 * i + 2.3 * k)).toFixed(6)).join(" "));
  fs.writeFileSync(file, `ply\nformat ascii 1.0\nelement vertex 400\n${names.map((name) => `property float ${name}\n`).join("")}end_header\n${rows.join("\n")}\n`);
}

if (!given) makeScene(at("made.txt.ply"));
ours(given ?? at("made.txt.ply"), at("scene.ply"));

// What both read in a file that one of them wrote is the same, to the rounding of single precision;
// opacities of 0 and 1 stand for ranges, of which the two choose different logits.
const LIMITS = { means: 1e-5, "log-scales": 1e-5, colours: 1e-5, SH: 1e-5, opacities: 0.3 / 255, rotations: 1e-5 };
const meta = path.join(files, "folder", "meta.json");
fs.mkdirSync(path.dirname(meta));
for (const [writer, write, name] of [["gs", ours, at("ours.sog")], ["gs", ours, meta], ["splat-transform", theirs, at("theirs.sog")]]) {
  write(at("scene.ply"), name);
  ours(name, at("by-gs.ply"));
  theirs(name, at("by-splat-transform.ply"));
  const found = differences(at("by-gs.ply"), at("by-splat-transform.ply"));
  const size = name === meta ? fs.readdirSync(path.dirname(meta)).reduce((sum, file) => sum + fs.statSync(path.join(path.dirname(meta), file)).size, 0) : fs.statSync(name).size;
  console.log(`${path.basename(name)} by ${writer}, ${size} bytes:`, Object.entries(found).map(([what, value]) => `${what} ${value.toExponential(1)}`).join(", "));
  for (const [what, value] of Object.entries(found)) assert.ok(value <= LIMITS[what], `${name}: ${what} differ by ${value}`);
}

console.log("SOG: both read the same numbers");
