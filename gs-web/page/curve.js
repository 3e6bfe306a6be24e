// The curves of a fit: number of Gaussians, loss on a logarithmic scale, and PSNR, by step.

const LINES = [
  { name: "Gaussians", at: 1, color: "#2a78c2" },
  { name: "loss (log)", at: 2, color: "#c2452a", log: true },
  { name: "PSNR", at: 3, color: "#2f8f46", unit: " dB" },
];
const DASHES = { a: [], b: [6, 4] };

/** Draws the points of each slot, rows of step, count, loss and PSNR. */
export function drawCurves(canvas, curves, front) {
  const ratio = Math.min(3, window.devicePixelRatio || 1);
  const [width, height] = [Math.max(200, canvas.clientWidth), 220];
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  context.font = "12px system-ui, sans-serif";
  const all = Object.values(curves).flat();
  const last = Math.max(1, ...all.map((row) => row[0]));
  LINES.forEach(({ name, at, color, log, unit = "" }, k) => {
    const number = (row) => (log ? Math.log10(Math.max(1e-12, row[at])) : row[at]);
    const values = all.filter((row) => row[at] !== null).map(number);
    if (values.length === 0) return;
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const y = (value) => height - 30 - ((height - 60) * (value - low)) / (high - low || 1);
    context.strokeStyle = color;
    context.lineWidth = 2;
    for (const [slot, rows] of Object.entries(curves)) {
      context.setLineDash(DASHES[slot]);
      context.beginPath();
      const every = Math.max(1, Math.floor(rows.length / 600));
      rows.forEach((row, i) => {
        if (row[at] !== null && (i % every === 0 || i === rows.length - 1)) {
          context.lineTo(10 + ((width - 20) * row[0]) / last, y(number(row)));
        }
      });
      context.stroke();
    }
    context.fillStyle = color;
    context.fillRect(10 + (k * (width - 20)) / 3, 8, 10, 10);
    context.fillStyle = front;
    const text = log ? (10 ** values.at(-1)).toExponential(2) : `${Math.round(100 * values.at(-1)) / 100}${unit}`;
    context.fillText(`${name} ${text}`, 24 + (k * (width - 20)) / 3, 17);
  });
  context.setLineDash([]);
  context.fillStyle = front;
  context.fillText(`step ${last}`, width - 70, height - 8);
}
