// A scene that is open in a worker that draws: the scene of a file, or the levels of a streamed SOG that have been
// fetched so far. Another worker reads the streamed SOG.

import { words } from "./answer.js";
import { Connection } from "./engine.js";

/** The most Gaussians that are drawn of a streamed SOG, by backend. */
const MOST_GAUSSIANS = { cpu: 300_000, wgpu: 1_000_000 };

/** Memory for levels that are not drawn at present, bytes. Cameras often come back. */
const ROOM = 128 << 20;

/** Whether this is the name of a file that describes a streamed SOG. */
const isStreamed = (name) => /(^|[/\\])lod-meta\.json$/i.test(name);

export class OpenScene {
  /** What the scene is. */
  info;
  /** What is drawn; `undefined` before the first levels have been fetched. */
  view;
  /** The number of its Gaussians. */
  gaussians = 0;
  /** Whether nothing more will be fetched for the last camera. */
  complete = true;
  #engine;
  #reader;
  /** Called with what has changed. */
  #changed;
  /** The number of cameras so far, and the last one. */
  #looks = 0;
  #looked;
  /** Settles when the view is no longer in use. On a GPU, a picture takes several turns of the event loop. */
  #turn = Promise.resolve();

  /**
   * Opens the bytes of a file. A streamed SOG also needs the file's address, a function that starts the worker that
   * reads, and the engine's module for that worker. `changed` is called with `{ gaussians, complete, isNew }`, where
   * `isNew` says whether there is something new to draw, or with `{ error, fatal }` when a part could not be fetched or
   * the engine stopped.
   */
  static async of(engine, { bytes, name, address, maxGaussians }, newReader, module, changed) {
    const scene = new OpenScene();
    scene.#engine = engine;
    scene.#changed = changed;
    if (!isStreamed(name)) {
      scene.view = engine.view(new Uint8Array(bytes), name);
      scene.info = JSON.parse(scene.view.info());
      scene.gaussians = scene.info.gaussians;
      return scene;
    }
    if (!address || location.protocol === "blob:") {
      throw new Error(`${name} refers to files beside it: open it by its address, on a page with several files such as that of gs serve`);
    }
    const budget = maxGaussians ?? MOST_GAUSSIANS[engine.name];
    if (!(budget >= 1)) throw new Error(`maxGaussians is ${maxGaussians}, and must be at least 1`);
    await scene.#read({ bytes, address, budget: Math.min(Math.floor(budget), 2 ** 32 - 1), room: ROOM, module }, newReader);
    return scene;
  }

  async #read(what, newReader) {
    this.complete = false;
    const reader = new Connection(newReader(), (event) => this.#heard(event));
    this.#reader = reader;
    try {
      const { gaussians, home } = await reader.ask("open", what);
      reader.opened = true;
      this.info = { kind: "3d", format: "streamed SOG", gaussians, shDegree: 0, losses: [], size: null, home, streamed: true };
    } catch (error) {
      reader.close();
      throw error;
    }
  }

  /** Handles an event of the worker that reads. */
  async #heard({ event, error, fatal, look, numbers, ...levels }) {
    if (event === "failure") {
      // Without the worker that reads, nothing more is fetched.
      if (fatal) this.#end();
      return this.#changed({ error });
    }
    if (numbers) {
      try {
        await this.#inTurn(() => this.#show(numbers, levels));
      } catch (error) {
        this.#end();
        return this.#changed({ error: words(error), fatal: true });
      }
      this.#reader?.taken();
    }
    // The event may be about an earlier camera, if the worker has not received the last one yet.
    if (levels.complete && look === this.#looks) this.complete = true;
    this.#changed({ gaussians: this.gaussians, complete: this.complete, isNew: Boolean(numbers) });
  }

  #show(numbers, { shDegree, antialias }) {
    // Memory may not suffice for both views.
    this.view?.free();
    this.view = undefined;
    this.view = this.#engine.levelsView(numbers, shDegree, antialias);
    this.gaussians = numbers.length / (11 + 3 * (shDegree + 1) ** 2);
  }

  #end() {
    this.#reader?.close();
    this.#reader = undefined;
    this.complete = true;
  }

  #inTurn(action) {
    const done = this.#turn.then(action);
    this.#turn = done.catch(() => {});
    return done;
  }

  /** Requests the levels that a picture of this size needs from the camera of a frame. */
  look({ camera }, [width, height]) {
    const frame = { width, height, camera };
    const looked = JSON.stringify(frame);
    if (!this.#reader || looked === this.#looked) return;
    this.#looked = looked;
    this.complete = false;
    this.#reader.ask("look", { frame, look: ++this.#looks }).catch(() => {});
  }

  /** The pixels of a frame, from what has been fetched so far; `undefined` before the first levels. */
  pixels(frame) {
    return this.#inTurn(() => this.view?.pixels(JSON.stringify(frame)));
  }

  free() {
    this.#end();
    this.#inTurn(() => this.view?.free());
  }
}
