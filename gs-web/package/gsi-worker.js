// The worker of <gsi-img>: it decodes one file after the other.

import { decode } from "./gsi.js";

let queue = Promise.resolve();

self.onmessage = ({ data: { id, bytes } }) => {
  queue = queue.then(async () => {
    try {
      const image = await decode(bytes);
      postMessage({ id, image }, [image.data.buffer]);
    } catch (error) {
      postMessage({ id, error: error?.message ?? String(error) });
    }
  });
};
