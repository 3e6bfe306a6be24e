/** Options of `decode`. */
export interface DecodeOptions {
  /** Also decode a file that ends anywhere after its header. Default: an error. */
  partial?: boolean;
}

/** A picture: RGBA, row by row from the top, alpha not multiplied into the colours. */
export interface DecodedImage {
  readonly width: number;
  readonly height: number;
  readonly data: Uint8ClampedArray;
  /** In Node alone, which converts no colours: the ICC profile of a picture that is not in sRGB. */
  readonly profile?: Uint8Array;
}

/**
 * Decodes a `.gsi` file, in the thread that calls it: an `ImageData` in sRGB; in Node, which has none, an object
 * with the same properties. The promise is rejected with an `Error` whose message says what is wrong with the file,
 * and names it if the source is a `Response` or a `File`.
 */
export function decode(
  source: ArrayBuffer | ArrayBufferView | Blob | Response,
  options?: DecodeOptions,
): Promise<ImageData & DecodedImage>;

/**
 * Loads the decoder ahead of the first `decode`, from the package or from another place: an address, a
 * response, bytes, or a module.
 */
export function load(wasm?: string | URL | Response | BufferSource | WebAssembly.Module): Promise<unknown>;

/**
 * `<gsi-img src fallback alt>`: a `.gsi` image, decoded in a worker. If it can't be had, the image `fallback` is
 * shown instead, or its `alt`. Events: `load` (detail: `width`, `height`) and `error` (detail: `error`,
 * `message`).
 */
export class GsiImageElement extends HTMLElement {}

declare global {
  interface HTMLElementTagNameMap {
    "gsi-img": GsiImageElement;
  }
}
