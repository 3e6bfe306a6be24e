// How many threads compute, and why so many.

/** The most threads. Each takes memory, and steps of a fit are too short for many more. */
const MOST = 16;

/**
 * The number of threads for the engine, and why. Several share its memory, which browsers allow on
 * cross-origin isolated pages only.
 */
export function threadsWanted() {
  const because = (count, why) => ({ count, why });
  if (!document.querySelector("meta[name=gs-threads]")) return because(1, "this page was built without threads");
  if (!globalThis.crossOriginIsolated) return because(1, "this page is not cross-origin isolated");
  const asked = Math.floor(Number(new URLSearchParams(location.search).get("threads")));
  if (asked >= 1) return because(Math.min(asked, MOST), "the address says so");
  const cores = navigator.hardwareConcurrency ?? 1;
  if (cores > MOST) return because(MOST, "the page takes no more");
  return because(cores, cores === 1 ? "this browser offers one core" : `this browser offers ${cores} cores`);
}

/** Says how many threads compute, and why. */
export const threadWords = ({ count, why }) => `${count === 1 ? "one thread" : `${count} threads`}, as ${why}`;
