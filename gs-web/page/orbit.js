// The camera of the page: it turns around a point, moves, and flies, from pointers, wheel and keys.
// Axes are those of scenes here: x right, y down, z forward.

const HALF_TURN = Math.PI;
const STEEPEST = 0.49 * Math.PI;

const add = (a, b, by = 1) => a.map((value, k) => value + by * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

export class Orbit {
  constructor(changed) {
    this.changed = changed;
    this.start({ position: [0, 0, -1], target: [0, 0, 0], up: [0, -1, 0], fov: 50 });
  }

  /** Takes the first camera of a scene, to which it comes back. */
  start(home) {
    this.home = home;
    this.look(home);
  }

  /** Takes a camera: its position, what it looks at, which way is up, its field of view. */
  look({ position, target, up, fov }) {
    const ahead = add(target, position, -1);
    const distance = Math.hypot(...ahead);
    if (!(distance > 0)) throw new RangeError("a camera must look at another place than its own");
    Object.assign(this, { target, fov, distance, size: distance });
    this.up = up[1] > 0 ? 1 : -1;
    this.yaw = Math.atan2(ahead[0], ahead[2]);
    this.pitch = Math.asin(-this.up * (ahead[1] / distance));
    this.changed();
  }

  restart() {
    this.look(this.home);
  }

  /** Below the horizon by the pitch. */
  #forward() {
    const level = Math.cos(this.pitch);
    return [level * Math.sin(this.yaw), -this.up * Math.sin(this.pitch), level * Math.cos(this.yaw)];
  }

  get pose() {
    const position = add(this.target, this.#forward(), -this.distance);
    return { position, target: this.target, up: [0, this.up, 0], fov: this.fov };
  }

  turn(x, y) {
    this.yaw -= this.up * x * HALF_TURN;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + y * HALF_TURN));
    this.changed();
  }

  zoom(factor) {
    this.distance = Math.min(1e4 * this.size, Math.max(1e-3 * this.size, this.distance * factor));
    this.changed();
  }

  /** Moves the picture by parts of its width. */
  pan(x, y) {
    this.fly(-x, -y, 0, this.distance);
  }

  /** Moves right, down and forward by parts of a length. */
  fly(right, down, forward, length = this.size) {
    const ahead = this.#forward();
    const aside = [Math.cos(this.yaw), 0, -Math.sin(this.yaw)].map((part) => -this.up * part);
    const below = cross(ahead, aside);
    this.target = add(add(add(this.target, aside, right * length), below, down * length), ahead, forward * length);
    this.changed();
  }

  /** Listens to an element. */
  attach(element) {
    const pointers = new Map();
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
      element.focus({ preventScroll: true });
    });
    element.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const size = Math.max(1, element.clientWidth);
      const [x, y] = [(event.clientX - before.clientX) / size, (event.clientY - before.clientY) / size];
      if (pointers.size === 2) {
        const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
        const apart = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY) + 1;
        this.zoom(apart(before) / apart(event));
        this.pan(x / 2, y / 2);
      } else if (event.shiftKey || event.buttons & 6) {
        this.pan(x, y);
      } else {
        this.turn(x, y);
      }
      pointers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      element.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(Math.sign(event.deltaY) * 0.1));
    }, { passive: false });
    element.addEventListener("keydown", (event) => {
      const action = KEYS[event.key.toLowerCase()];
      if (!action || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      action(this);
    });
  }
}

const STEP = 0.05;
const KEYS = {
  arrowleft: (on) => on.turn(-STEP, 0),
  arrowright: (on) => on.turn(STEP, 0),
  arrowup: (on) => on.turn(0, STEP),
  arrowdown: (on) => on.turn(0, -STEP),
  "+": (on) => on.zoom(0.9),
  "=": (on) => on.zoom(0.9),
  "-": (on) => on.zoom(1.1),
  w: (on) => on.fly(0, 0, STEP),
  s: (on) => on.fly(0, 0, -STEP),
  a: (on) => on.fly(-STEP, 0, 0),
  d: (on) => on.fly(STEP, 0, 0),
  q: (on) => on.fly(0, -STEP, 0),
  e: (on) => on.fly(0, STEP, 0),
  home: (on) => on.restart(),
};
