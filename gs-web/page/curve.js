// The curves of a fit: number of Gaussians, loss on a logarithmic scale, and PSNR, by step.

const LINES = [
  { name: "Gaussians", at: 1, color: "#2a78c2", text: (value) => value.toLocaleString("en") },
  { name: "loss (log)", at: 2, color: "#c2452a", log: true, text: (value) => value.toExponential(1) },
  { name: "PSNR", at: 3, color: "#2f8f46", text: (value) => `${value.toFixed(1)} dB` },
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

/** Draws the curve of each slot, each quantity within its own range, which the legend shows. */
export function drawCurves(canvas, curves, front) {
  // Large screens have larger letters.
  const size = Number.parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
  const ratio = size * Math.min(3, window.devicePixelRatio || 1);
  const width = Math.max(200, canvas.clientWidth / size);
  const [columns, rows] = [width, HEIGHT].map((side) => Math.round(side * ratio));
  if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, HEIGHT);
  context.font = "12px system-ui, sans-serif";
  const slots = Object.entries(curves).map(([slot, curve]) => [slot, curve.all]);
  const lines = LINES.map((line) => ({ ...line, ...rangeOf(line, slots) })).filter(({ low }) => low !== undefined);
  const top = drawLegend(context, lines, width, front);
  const last = slots.reduce((most, [, points]) => Math.max(most, points.at(-1)?.[0] ?? 0), 1);
  for (const line of lines) drawLine(context, line, slots, { width, top, last });
  context.setLineDash([]);
  context.textAlign = "right";
  context.fillText(`step ${last}`, width - EDGE, HEIGHT - 8);
  context.textAlign = "left";
}

/** The least and the largest value of a quantity in all slots. */
function rangeOf({ at }, slots) {
  let [low, high] = [undefined, undefined];
  for (const [, rows] of slots) {
    for (const { [at]: value } of rows) {
      if (value === null) continue;
      [low, high] = [Math.min(low ?? value, value), Math.max(high ?? value, value)];
    }
  }
  return { low, high };
}

/** Draws names and ranges, in as many rows as they need, and returns where the last row ends. */
function drawLegend(context, lines, width, front) {
  let [x, y] = [EDGE, 17];
  for (const { name, color, low, high, text } of lines) {
    const words = low === high ? `${name} ${text(low)}` : `${name} ${text(low)} to ${text(high)}`;
    const length = 30 + context.measureText(words).width;
    if (x > EDGE && x + length > width) [x, y] = [EDGE, y + 18];
    context.fillStyle = color;
    context.fillRect(x, y - 9, 10, 10);
    context.fillStyle = front;
    context.fillText(words, x + 14, y);
    x += length;
  }
  return y;
}

function drawLine(context, { at, color, log, low, high }, slots, { width, top, last }) {
  const number = (value) => (log ? Math.log10(Math.max(1e-12, value)) : value);
  const [bottom, from, span] = [HEIGHT - 30, number(low), number(high) - number(low) || 1];
  context.strokeStyle = color;
  context.lineWidth = 2;
  for (const [slot, rows] of slots) {
    context.setLineDash(DASHES[slot]);
    context.beginPath();
    for (const row of rows) {
      if (row[at] === null) continue;
      context.lineTo(EDGE + ((width - 2 * EDGE) * row[0]) / last, bottom - ((bottom - top - 14) * (number(row[at]) - from)) / span);
    }
    context.stroke();
  }
}
