// Where the worker and the WebAssembly are in a page of one file: in elements of the page itself.

export async function engineParts() {
  const text = (id) => document.getElementById(id).textContent;
  const source = new Blob([text("worker-source")], { type: "text/javascript" });
  const newWorker = () => new Worker(URL.createObjectURL(source));
  const packed = await fetch(`data:application/octet-stream;base64,${text("wasm")}`);
  const unpacked = packed.body.pipeThrough(new DecompressionStream("gzip"));
  return { newWorker, wasm: await new Response(unpacked).arrayBuffer() };
}
