// The camera of the page: it turns around a point, moves, and flies, from pointers, wheel and keys. Its axes are
// up, north, which is any direction across, and east.

const HALF_TURN = Math.PI;
const STEEPEST = 0.49 * Math.PI;

const add = (a, b, by = 1) => a.map((value, k) => value + by * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (a) => a.map((part) => part / Math.hypot(...a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** The directions that have names. */
const DIRECTIONS = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], "-x": [-1, 0, 0], "-y": [0, -1, 0], "-z": [0, 0, -1] };

/** The direction of a name such as "z" or "-y"; none for another text. */
export const directionOf = (name) => DIRECTIONS[name?.trim().toLowerCase()];

/** A direction across another one: z, or y if that is too near. */
function across(up) {
  const to = Math.abs(up[2]) < 0.9 ? DIRECTIONS.z : DIRECTIONS.y;
  return unit(add(to, up, -dot(to, up)));
}

/** The first camera of a scene in which another direction is up: slightly above, too, and as far away. */
export function homeWith(home, direction) {
  const up = unit(direction);
  const distance = Math.hypot(...add(home.position, home.target, -1));
  const away = unit(add(across(up), up, -0.35));
  return { ...home, up, position: add(home.target, away, -distance) };
}

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
    if (!(Math.hypot(...up) > 0)) throw new RangeError("which way is up must be a direction");
    Object.assign(this, { target, fov, distance, size: distance });
    this.up = unit(up);
    this.north = across(this.up);
    this.east = cross(this.north, this.up);
    this.yaw = Math.atan2(dot(ahead, this.east), dot(ahead, this.north));
    this.pitch = Math.asin(Math.max(-1, Math.min(1, -dot(ahead, this.up) / distance)));
    this.changed();
  }

  restart() {
    this.look(this.home);
  }

  /** Below the horizon by the pitch. */
  #forward() {
    const level = add(this.east.map((part) => Math.sin(this.yaw) * part), this.north, Math.cos(this.yaw));
    return add(level.map((part) => Math.cos(this.pitch) * part), this.up, -Math.sin(this.pitch));
  }

  get pose() {
    const position = add(this.target, this.#forward(), -this.distance);
    return { position, target: this.target, up: this.up, fov: this.fov };
  }

  turn(x, y) {
    this.yaw += x * HALF_TURN;
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
    const aside = add(this.east.map((part) => Math.cos(this.yaw) * part), this.north, -Math.sin(this.yaw));
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
