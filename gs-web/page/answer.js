// How the workers of the page and of the npm package answer requests.

/**
 * Answers a request by the function of its name: `{ id, result }`, or what `failure` says. `engine` is the engine
 * that is open, if there is one.
 */
export async function answer({ id, request, ...rest }, requests, engine) {
  try {
    const result = await requests[request](rest);
    postMessage({ id, result }, result instanceof Uint8Array ? [result.buffer] : []);
  } catch (error) {
    postMessage({ id, ...(await failure(error, engine)) });
  }
}

/** What went wrong, in words, and whether the engine can't go on: it has stopped, or its device is lost. */
export async function failure(error, engine) {
  return { error: words(error), fatal: await isFatal(error, engine) };
}

async function isFatal(error, engine) {
  if (error instanceof WebAssembly.RuntimeError) return true;
  return engine !== undefined && !(await engine.works().catch(() => false));
}

/** What went wrong, in words. */
export function words(error) {
  if (error instanceof WebAssembly.RuntimeError) return `the engine stopped: ${error.message}`;
  if (error instanceof RangeError) return "there is not enough memory for this; use a smaller image or scene";
  return error?.message ?? String(error);
}
