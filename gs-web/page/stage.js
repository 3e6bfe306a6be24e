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
  /** Settles when the last picture has been drawn, or could not be. */
  #last = Promise.resolve();
  /** The picture after the one that is being drawn, if it is wanted; and whether it may be coarse. */
  #next;
  #moving = false;
  #coarse = 1;
  #rest = 0;
  /** Whether the camera has moved and has not come to rest since. */
  #inMotion = false;
  /** The rectangle of a 2D scene, px of its image. */
  #rectangle;

  /**
   * `size` returns columns and rows of the canvas, px, 0 while it is hidden. `draw` draws a frame, which may be coarser
   * than this size, and returns the time that it took, ms.
   */
  constructor({ size, draw }) {
    this.#size = size;
    this.#draw = draw;
    this.orbit = new Orbit(() => this.#moved());
  }

  /** Takes a scene and draws it; with `again`, the camera stays where it is. */
  show(info, again = false) {
    const { kind, size, home } = info;
    this.info = info;
    this.#rectangle = kind === "2d" ? [0, 0, ...size] : undefined;
    this.#coarse = 1;
    if (home && !again) this.orbit.start(home);
    return this.draw();
  }

  /** What is drawn of the scene at this size. */
  frame([width, height], moving = false) {
    const frame = { width, height };
    if (this.#rectangle) {
      // The whole image, with its sides in proportion.
      const [, , columns, rows] = this.#rectangle;
      const scale = Math.max(columns / width, rows / height);
      frame.rectangle = [(columns - width * scale) / 2, (rows - height * scale) / 2, width * scale, height * scale];
      return frame;
    }
    return { ...frameOf(this.orbit.pose, [width, height]), moving };
  }

  /** Columns and rows of a picture that is coarser by a factor. */
  size(divisor = 1) {
    return this.#size().map((side) => Math.round(side / divisor));
  }

  #moved() {
    clearTimeout(this.#rest);
    this.#inMotion = true;
    this.#rest = setTimeout(() => this.draw(), REST_MS);
    this.draw(true);
  }

  /** Waits until all requested pictures are drawn, and returns whether the camera is at rest then. */
  async rested() {
    await (this.#next ?? this.#last).catch(() => {});
    return !this.#next && !this.#inMotion;
  }

  /** Draws a scene that has changed, coarsely if its camera is moving. */
  changed() {
    return this.draw(this.#inMotion);
  }

  /**
   * Draws the scene; one picture at a time, and the last view always. The promise is fulfilled when a picture of
   * this view or of a later one is drawn, and rejected if it could not be.
   */
  draw(moving = false) {
    this.#moving = moving && (this.#moving || !this.#next);
    this.#next ??= this.#last.then(() => this.#picture());
    return this.#next;
  }

  async #picture() {
    const moving = this.#moving;
    this.#last = this.#next.catch(() => {});
    this.#next = undefined;
    if (!moving) {
      clearTimeout(this.#rest);
      this.#inMotion = false;
    }
    if (!this.info || this.size().includes(0)) return;
    const size = this.size(moving ? this.#coarse : 1).map((side) => Math.max(1, side));
    const took = await this.#draw(this.frame(size, moving), this.size());
    if (moving && took > MOVING_MS && this.#coarse < 8) this.#coarse *= 1.5;
    else if (moving && took < MOVING_MS / 4 && this.#coarse > 1) this.#coarse = Math.max(1, this.#coarse / 1.5);
  }
}

/** A picture of this size from a camera. */
export function frameOf({ fov, ...pose }, [width, height]) {
  return { width, height, camera: { ...pose, fov: acrossOf(fov, width, height) } };
}

/** The horizontal field of view of a picture whose shorter side has the field of view `fov`, degrees. */
function acrossOf(fov, width, height) {
  const half = Math.tan((fov * Math.PI) / 360) * Math.max(1, width / height);
  return (Math.atan(half) * 360) / Math.PI;
}
