// A scene that is open in a worker that draws: that of a file, or what is there of the levels of detail of a
// streamed SOG, which another worker reads.

import { Connection } from "./engine.js";

/** The most Gaussians that are drawn of a streamed SOG, by backend. */
const MOST_GAUSSIANS = { cpu: 300_000, wgpu: 1_000_000 };

/** Memory for levels that are not drawn at present, bytes: cameras often come back. */
const ROOM = 128 << 20;

/** Whether a file has this name that describes a streamed SOG. */
const isStreamed = (name) => /(^|[/\\])lod-meta\.json$/i.test(name);

export class OpenScene {
  /** What the scene is. */
  info;
  /** What is drawn; nothing before the first levels are there. */
  view;
  /** The number of its Gaussians. */
  gaussians = 0;
  /** Whether all is there that the last camera needs. */
  complete = true;
  #engine;
  #reader;
  #looked;

  /**
   * Opens the bytes of a file. Those of a streamed SOG need the file's address, what starts the worker that reads, and
   * the engine's module for it. `changed` is called with `{ gaussians, complete }` when more of it can be drawn, and with an `error` when
   * a part can't be had.
   */
  static async of(engine, { bytes, name, address, maxGaussians }, newReader, module, changed) {
    const scene = new OpenScene();
    scene.#engine = engine;
    if (!isStreamed(name)) {
      scene.view = engine.view(new Uint8Array(bytes), name);
      scene.info = JSON.parse(scene.view.info());
      scene.gaussians = scene.info.gaussians;
      return scene;
    }
    if (!address) throw new Error(`${name} refers to files beside it: open it by its address on a server, such as gs serve`);
    const budget = maxGaussians ?? MOST_GAUSSIANS[engine.name];
    await scene.#read({ bytes, address, budget, room: ROOM, module }, newReader, changed);
    return scene;
  }

  async #read(what, newReader, changed) {
    this.complete = false;
    const heard = ({ event, error, numbers, shDegree, antialias, complete }) => {
      if (event === "failure") return changed({ error });
      if (numbers) {
        // There may not be memory for both.
        this.view?.free();
        this.view = undefined;
        this.view = this.#engine.levelsView(numbers, shDegree, antialias);
        this.gaussians = numbers.length / (11 + 3 * (shDegree + 1) ** 2);
        this.#reader.taken();
      }
      this.complete = complete;
      changed({ gaussians: this.gaussians, complete });
    };
    this.#reader = new Connection(newReader(), heard);
    try {
      const { gaussians, home } = await this.#reader.ask("open", what);
      this.#reader.opened = true;
      this.info = { kind: "3d", format: "streamed SOG", gaussians, shDegree: 0, losses: [], size: null, home, streamed: true };
    } catch (error) {
      this.#reader.close();
      throw error;
    }
  }

  /** Lets the levels be read that a frame needs. */
  look(frame) {
    const looked = JSON.stringify(frame.camera ?? null);
    if (!this.#reader || looked === this.#looked) return;
    this.#looked = looked;
    this.complete = false;
    this.#reader.ask("look", { frame: { width: frame.width, height: frame.height, camera: frame.camera } }).catch(() => {});
  }

  /** The pixels of a frame, of what is there; none where nothing is there yet. */
  async pixels(frame) {
    this.look(frame);
    return this.view?.pixels(JSON.stringify(frame));
  }

  free() {
    this.#reader?.close();
    this.view?.free();
  }
}
