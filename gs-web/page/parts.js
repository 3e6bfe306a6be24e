// Where the worker and the WebAssembly are. In a page of one file they are inside it instead.

export async function engineParts() {
  const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
  const response = await fetch(new URL("gs_web_bg.wasm", import.meta.url));
  return { worker, wasm: await response.arrayBuffer() };
}
