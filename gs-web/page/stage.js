// What draws a scene while its camera moves: one picture at a time, coarser while pictures take long.

import { Orbit } from "./orbit.js";

/** The longest time of a frame while the camera moves, ms; slower pictures get coarser. */
const MOVING_MS = 120;
/** Time after the last movement until the picture is drawn at full size, ms. */
const REST_MS = 250;

export class Stage {
  /** What the engine says of the scene. */
  info;
  /** The camera of a 3D scene. */
  orbit;
  #size;
  #draw;
  #busy = false;
  #again = false;
  #coarse = 1;
  #rest = 0;
  /** The rectangle of a 2D scene, px of its image. */
  #rectangle;

  /**
   * `size` gives columns and rows of the canvas, px, 0 while it is hidden; `draw` draws a frame, and gives
   * the time that it took, ms, or `undefined` if it could not.
   */
  constructor({ size, draw }) {
    this.#size = size;
    this.#draw = draw;
    this.orbit = new Orbit(() => this.#moved());
  }

  /** Takes a scene; with `again`, the camera stays where it is. */
  show(info, again = false) {
    const { kind, size, home } = info;
    this.info = info;
    this.#rectangle = kind === "2d" ? [0, 0, ...size] : undefined;
    this.#coarse = 1;
    if (home && !again) this.orbit.start(home);
    return this.draw();
  }

  /** What is drawn of the scene at this size. */
  frame([width, height]) {
    const frame = { width, height };
    if (this.#rectangle) {
      // The whole image, with its sides in proportion.
      const [, , columns, rows] = this.#rectangle;
      const scale = Math.max(columns / width, rows / height);
      frame.rectangle = [(columns - width * scale) / 2, (rows - height * scale) / 2, width * scale, height * scale];
      return frame;
    }
    const { fov, ...pose } = this.orbit.pose;
    frame.camera = { ...pose, fov: acrossOf(fov, width, height) };
    return frame;
  }

  /** Columns and rows of a picture that is coarser by a factor. */
  size(divisor = 1) {
    return this.#size().map((side) => Math.round(side / divisor));
  }

  #moved() {
    clearTimeout(this.#rest);
    this.#rest = setTimeout(() => this.draw(), REST_MS);
    this.draw(true);
  }

  /** Draws the scene; one picture at a time, and the last view always. */
  async draw(moving = false) {
    if (!this.info || this.size().includes(0)) return;
    if (this.#busy) {
      this.#again = true;
      return;
    }
    this.#busy = true;
    const size = this.size(moving ? this.#coarse : 1).map((side) => Math.max(1, side));
    const took = await this.#draw(this.frame(size));
    if (moving && took > MOVING_MS && this.#coarse < 8) this.#coarse *= 1.5;
    else if (moving && took < MOVING_MS / 4 && this.#coarse > 1) this.#coarse = Math.max(1, this.#coarse / 1.5);
    this.#busy = false;
    const again = this.#again && took !== undefined;
    this.#again = false;
    if (again) this.draw(true);
  }
}

/** The horizontal field of view of a picture whose shorter side has the field of view `fov`, degrees. */
function acrossOf(fov, width, height) {
  const half = Math.tan((fov * Math.PI) / 360) * Math.max(1, width / height);
  return (Math.atan(half) * 360) / Math.PI;
}
