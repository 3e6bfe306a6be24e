// The curves of a fit: number of Gaussians, loss on a logarithmic scale, and PSNR, by step.

const LINES = [
  { name: "Gaussians", at: 1, color: "#2a78c2" },
  { name: "Loss (log)", at: 2, color: "#c2452a", log: true },
  { name: "PSNR", at: 3, color: "#2f8f46", unit: " dB" },
];
const DASHES = { a: [], b: [6, 4] };
/** Most points of a curve; of longer fits every second one is left out, as often as needed. */
const MOST = 1000;
const HEIGHT = 220;
const EDGE = 10;

/** The points of a fit, rows of step, count, loss and PSNR, and the last one. */
export class Curve {
  rows = [];
  last;
  /** Number of steps. */
  seen = 0;
  #every = 1;

  add(rows) {
    for (const row of rows) {
      this.last = row;
      if (this.seen++ % this.#every === 0) this.rows.push(row);
      if (this.rows.length <= MOST) continue;
      this.rows = this.rows.filter((_, k) => k % 2 === 0);
      this.#every *= 2;
    }
    return this;
  }

  /** Forgets what came after a step. */
  cut(step) {
    this.rows = this.rows.filter((row) => row[0] <= step);
    this.last = this.rows.at(-1);
    this.seen = step;
  }

  get all() {
    return this.last && this.last !== this.rows.at(-1) ? [...this.rows, this.last] : this.rows;
  }
}

/** Draws the curve of each slot. */
export function drawCurves(canvas, curves, front) {
  const ratio = Math.min(3, window.devicePixelRatio || 1);
  const width = Math.max(200, canvas.clientWidth);
  const [columns, rows] = [width, HEIGHT].map((side) => Math.round(side * ratio));
  if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, HEIGHT);
  context.font = "12px system-ui, sans-serif";
  const lines = Object.entries(curves).map(([slot, curve]) => [slot, curve.all]);
  const last = lines.reduce((most, [, points]) => Math.max(most, points.at(-1)?.[0] ?? 0), 1);
  LINES.forEach((line, k) => drawLine(context, line, lines, { width, last, front, left: EDGE + (k * (width - 2 * EDGE)) / 3 }));
  context.setLineDash([]);
  context.fillStyle = front;
  context.textAlign = "right";
  context.fillText(`step ${last}`, width - EDGE, HEIGHT - 8);
  context.textAlign = "left";
}

/** Draws one quantity of all slots within its own range, and its last value beside its name. */
function drawLine(context, { name, at, color, log, unit = "" }, lines, { width, last, front, left }) {
  const number = (row) => (log ? Math.log10(Math.max(1e-12, row[at])) : row[at]);
  let [low, high, latest] = [Infinity, -Infinity, undefined];
  for (const [, rows] of lines) {
    for (const row of rows) {
      if (row[at] === null) continue;
      [low, high, latest] = [Math.min(low, number(row)), Math.max(high, number(row)), row[at]];
    }
  }
  if (latest === undefined) return;
  const [x, y] = [
    (step) => EDGE + ((width - 2 * EDGE) * step) / last,
    (value) => HEIGHT - 30 - ((HEIGHT - 60) * (value - low)) / (high - low || 1),
  ];
  context.strokeStyle = color;
  context.lineWidth = 2;
  for (const [slot, rows] of lines) {
    context.setLineDash(DASHES[slot]);
    context.beginPath();
    for (const row of rows) if (row[at] !== null) context.lineTo(x(row[0]), y(number(row)));
    context.stroke();
  }
  context.fillStyle = color;
  context.fillRect(left, 8, 10, 10);
  context.fillStyle = front;
  const text = log ? latest.toExponential(2) : `${Math.round(100 * latest) / 100}${unit}`;
  context.fillText(`${name} ${text}`, left + 14, 17);
}
