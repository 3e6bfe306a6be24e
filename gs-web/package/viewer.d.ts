/** A camera. World axes are x right, y down, z forward. */
export interface Camera {
  /** Where it is, world units. */
  position: [number, number, number];
  /** What it looks at. */
  target: [number, number, number];
  /** Which way is up: any direction but that of the view. Scenes do not say it, so it is -y at first. */
  up: [number, number, number];
  /** Field of view of the picture's shorter side, degrees. */
  fov: number;
}

/** What a scene is. */
export interface SceneInfo {
  kind: "2d" | "3d";
  /** The file's format, such as "SOG". */
  format: string;
  gaussians: number;
  /** Degree of the spherical harmonics, 0 to 3. Always 0 for a scene with levels of detail: only its chunks say it. */
  shDegree: number;
  /** What was lost or changed when the file was read, in sentences. */
  losses: string[];
  /** Columns and rows of a 2D scene, px. */
  size: [number, number] | null;
  /** The first camera of a 3D scene. */
  home: Camera | null;
  /** Whether it has levels of detail, fetched as cameras need them. `gaussians` is then that of the finest level. */
  streamed?: boolean;
}

/** A scene: an address, a file, or its bytes. */
export type Source = string | URL | Blob | ArrayBuffer | ArrayBufferView;

export interface ViewerOptions {
  /** What computes. "fastest", the default, is WebGPU where the browser has it. */
  backend?: "fastest" | "cpu" | "wgpu";
  /** Colour behind the scene, red, green and blue, 0 to 1. Default: the scene's own. */
  background?: [number, number, number];
  /** Whether pointers, wheel and keys move the camera. Default: true. */
  controls?: boolean;
  /** What a screen reader says of the canvas. */
  label?: string;
  /**
   * The most Gaussians of a scene with levels of detail (`lod-meta.json`) that are drawn, at least 1. Default:
   * 1,000,000 with WebGPU, 300,000 on the CPU. There are more if the coarsest levels have more, or until coarser levels
   * have been fetched.
   */
  maxGaussians?: number;
  /** After each picture. */
  ondraw?: (picture: Drawn) => void;
  /**
   * Called in two cases. If a chunk of a scene with levels of detail could not be fetched, the scene stays open without
   * it. If the engine has stopped while it drew the open scene, and the next one, on the CPU, has stopped too, no scene
   * is open any more; another one can be loaded.
   */
  onerror?: (error: Error) => void;
}

/** A picture that was drawn. */
export interface Drawn {
  /** Its size, px. */
  width: number;
  height: number;
  /** The time that it took, ms. */
  took: number;
  /** The number of Gaussians of the scene; of a scene with levels of detail, those of the levels that are shown. */
  gaussians: number;
  /**
   * Whether nothing more will be fetched for the camera: all levels that it needs are there, except chunks that could
   * not be fetched. Always true for scenes without levels of detail. When it becomes true without a new picture,
   * `ondraw` is called again.
   */
  complete: boolean;
}

export interface LoadOptions {
  /** The file name of bytes, whose ending says the format where the content doesn't (`.splat`). */
  name?: string;
  /** Ends the loading: the promise is rejected with the signal's reason. */
  signal?: AbortSignal;
  /** The download so far, bytes. */
  progress?: (download: Progress) => void;
  /** What differs from the scene's first camera. With `up` and without `position`, it looks from slightly above, too. */
  camera?: Partial<Camera>;
}

export interface Progress {
  loaded: number;
  /** `undefined` where the server doesn't say. */
  total: number | undefined;
}

/** A viewer, in a canvas of its own, in an element whose size it takes. */
export class Viewer {
  constructor(place: Element, options?: ViewerOptions);
  /**
   * Opens a scene: PLY, compressed PLY, `.splat`, `.ksplat`, SPZ, SOG, glTF with its buffer inside, 2D scenes, `.gsi`,
   * or the address of a streamed SOG (`lod-meta.json`). When the promise is fulfilled, the scene is drawn, unless the
   * element has no size yet. The promise is rejected with an `Error` if the file can't be fetched, read or drawn; the
   * scene that was open before stays open. It is rejected with an `AbortError` if another scene is loaded or the viewer
   * is disposed of first.
   */
  load(source: Source, options?: LoadOptions): Promise<SceneInfo>;
  /** The scene that is open. */
  readonly info: SceneInfo | undefined;
  /** The backend that computes and why it was chosen. `undefined` while no engine is open. */
  readonly engine: { backend: "cpu" | "wgpu"; reason: string } | undefined;
  /** The camera of a 3D scene. What is set may leave out what stays. */
  get camera(): Camera;
  set camera(camera: Partial<Camera>);
  set background(color: [number, number, number] | undefined);
  /** Takes the scene's first camera again: that of the file, or of `load`. */
  reset(): void;
  /** A PNG of what is shown, in the size of the element or in `[columns, rows]` px. */
  snapshot(size?: [number, number]): Promise<Blob>;
  /** Ends the worker and removes the canvas. */
  dispose(): void;
}

/**
 * `<gs-viewer src poster background camera fov up alt backend max-gaussians controls="none">`. What is inside the
 * element is shown if the scene can't be. Events: `load` (detail: `SceneInfo`), `progress` (detail: `Progress`) and
 * `error` (detail: `error`, `message`).
 */
export class GsViewerElement extends HTMLElement {
  src: string;
  readonly viewer: Viewer | undefined;
}

declare global {
  interface HTMLElementTagNameMap {
    "gs-viewer": GsViewerElement;
  }
}
