// Decodes .gsi images: the function `decode`, and the element <gsi-img>. gsi.d.ts says what each takes and gives.

import init, { Picture, __wbg_reset_state as restart } from "./gs_picture.js";

const WASM = new URL("./gs_picture_bg.wasm", import.meta.url);

let loaded;

/** Loads the decoder. `decode` does so itself; `wasm` is for places that keep the file elsewhere. */
export function load(wasm) {
  loaded ??= (async () => init({ module_or_path: wasm ?? (await wasmOf(WASM)) }))().catch((error) => {
    loaded = undefined;
    throw error;
  });
  return loaded;
}

/** Node's `fetch` reads no files. */
async function wasmOf(address) {
  if (address.protocol !== "file:" || typeof process === "undefined") return address;
  const { readFile } = await import(/* @vite-ignore */ /* webpackIgnore: true */ "node:fs/promises");
  return readFile(address);
}

/** Decodes the bytes of a file, a `Blob` or a `Response`. */
export async function decode(source, { partial = false } = {}) {
  await load();
  const { width, height, profile, pixels } = decoded(await bytesOf(source), partial, source.url || source.name);
  const data = new Uint8ClampedArray(pixels.buffer);
  if (typeof ImageData === "undefined") return { width, height, data, ...(profile.length > 0 && { profile }) };
  return profile.length > 0 ? inSrgb(width, height, pixels, profile) : new ImageData(data, width, height);
}

/** What a file contains. An error starts with its name, if it has one. */
function decoded(bytes, partial, name) {
  try {
    const picture = Picture.decode(bytes, partial);
    const { width, height } = picture;
    return { width, height, profile: picture.profile(), pixels: picture.pixels() };
  } catch (cause) {
    const hasStopped = cause instanceof WebAssembly.RuntimeError || cause instanceof RangeError;
    // The next picture gets a new instance.
    if (hasStopped) restart();
    const words = [name, hasStopped && "the decoder stopped", cause.message].filter(Boolean);
    throw new Error(words.join(": "), { cause });
  }
}

async function bytesOf(source) {
  if (source instanceof Uint8Array) return source;
  if (ArrayBuffer.isView(source)) return new Uint8Array(source.buffer, source.byteOffset, source.byteLength);
  if (source instanceof ArrayBuffer) return new Uint8Array(source);
  if (source.ok === false) throw new Error(`${source.url}: the server answers ${source.status} ${source.statusText}`.trim());
  return new Uint8Array(await source.arrayBuffer());
}

/** Converts the colours of a profile. Browsers do so for the images that they decode: they get a PNG. */
async function inSrgb(width, height, pixels, profile) {
  const { png } = await import("./png.js");
  const bitmap = await createImageBitmap(await png(width, height, pixels, profile), { premultiplyAlpha: "none" });
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, width, height);
}

/** The worker of all elements of the page, once one of them needs it. */
let worker;
const waiting = new Map();
let next = 1;

function decodeAside(bytes, name) {
  worker ??= started();
  return new Promise((resolve, reject) => {
    const id = next++;
    waiting.set(id, { resolve, reject: (words) => reject(new Error(`${name}: ${words}`)) });
    worker.postMessage({ id, bytes }, [bytes]);
  });
}

function started() {
  const decoder = new Worker(new URL("./gsi-worker.js", import.meta.url), { type: "module" });
  decoder.onmessage = ({ data: { id, image, error } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    image ? resolve(image) : reject(error);
  };
  decoder.onerror = (event) => {
    event.preventDefault();
    for (const { reject } of waiting.values()) reject(event.message ?? "the decoder did not start");
    waiting.clear();
    // The next image starts another one.
    decoder.terminate();
    worker = undefined;
  };
  return decoder;
}

const STYLE = `
:host { display: inline-block; max-width: 100%; }
:host([hidden]) { display: none; }
canvas, img { display: block; width: 100%; height: 100%; }
`;

/** <gsi-img src="photo.gsi" fallback="photo.jpg" alt="…">. Where there are no custom elements, there is no element. */
const Base = typeof HTMLElement === "undefined" ? class {} : HTMLElement;

export class GsiImageElement extends Base {
  static observedAttributes = ["src", "alt"];
  #root;
  #abort;
  /** The source that is shown, or on its way. */
  #asked;

  constructor() {
    super();
    this.#root = this.attachShadow({ mode: "open" });
    this.#root.innerHTML = `<style>${STYLE}</style>`;
  }

  connectedCallback() {
    // An element that is moved has its image, and one that is upgraded has begun with its attributes.
    if (this.getAttribute("src") !== this.#asked) this.#show();
  }

  disconnectedCallback() {
    // An element that is only moved is back in the page by then.
    queueMicrotask(() => this.isConnected || this.#leave());
  }

  #leave() {
    this.#abort?.abort();
    this.#asked = undefined;
  }

  attributeChangedCallback(name, before, after) {
    if (!this.isConnected || before === after) return;
    if (name === "src") this.#show();
    else this.#label(this.#root.querySelector("canvas, img"));
  }

  async #show() {
    this.#abort?.abort();
    const source = (this.#asked = this.getAttribute("src"));
    if (!source) return this.#put();
    const { signal } = (this.#abort = new AbortController());
    try {
      const response = await fetch(source, { signal });
      if (!response.ok) throw new Error(`${source}: the server answers ${response.status} ${response.statusText}`.trim());
      const image = await decodeAside(await response.arrayBuffer(), source);
      if (signal.aborted) return;
      const canvas = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
      canvas.getContext("2d").putImageData(image, 0, 0);
      canvas.setAttribute("role", "img");
      this.#put(canvas);
      this.dispatchEvent(new CustomEvent("load", { detail: { width: image.width, height: image.height } }));
    } catch (error) {
      if (signal.aborted) return;
      this.#put(this.#fallback());
      this.dispatchEvent(new CustomEvent("error", { detail: { error, message: error.message } }));
    }
  }

  #fallback() {
    const img = document.createElement("img");
    const source = this.getAttribute("fallback");
    if (source) img.src = source;
    return img;
  }

  /** Shows a canvas or an image, or nothing. */
  #put(element) {
    this.#root.querySelector("canvas, img")?.remove();
    if (element) this.#root.appendChild(this.#label(element));
  }

  #label(element) {
    const text = this.getAttribute("alt") ?? "";
    if (element?.tagName === "CANVAS") element.setAttribute("aria-label", text);
    else if (element) element.alt = text;
    return element;
  }
}

if (typeof customElements !== "undefined" && !customElements.get("gsi-img")) {
  customElements.define("gsi-img", GsiImageElement);
}
