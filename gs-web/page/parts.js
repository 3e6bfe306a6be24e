// Where the workers and the WebAssembly are: beside the page, or with several threads in a folder of
// their own. In a page of one file they are inside it instead.

export async function engineParts(count) {
  const folder = count > 1 ? "threads/" : "";
  const newWorker = () => new Worker(new URL(`${folder}worker.js`, import.meta.url), { type: "module" });
  const response = await fetch(new URL(`${folder}gs_web_bg.wasm`, import.meta.url));
  return { newWorker, wasm: await response.arrayBuffer() };
}
