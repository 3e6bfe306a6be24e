// The page's side of the workers: requests as promises, events as a callback.

/** A worker. `onEvent` gets what it says unasked, and `failure` if it breaks. */
export class Connection {
  /** Whether the engine has been opened: what fails before that is an answer, not an event. */
  opened = false;
  #worker;
  #onEvent;
  /** The other threads of its engine. */
  #threads = [];
  #waiting = new Map();
  #next = 1;
  #failure;

  constructor(worker, onEvent) {
    this.#worker = worker;
    this.#onEvent = onEvent;
    worker.onmessage = ({ data }) => {
      if (data.event) return onEvent(data, this);
      const { resolve, reject } = this.#waiting.get(data.id);
      this.#waiting.delete(data.id);
      if ("error" in data) reject(Object.assign(new Error(data.error), { fatal: data.fatal }));
      else resolve(data.result);
    };
    worker.onerror = (event) => {
      event.preventDefault();
      this.#broken(event.message ?? "the worker did not start");
    };
  }

  /** Loads the engine's module. With more than one thread, other workers compute in its memory. */
  async load(wasm, count, newWorker) {
    const shared = await this.ask("load", { wasm, shares: count > 1 });
    this.#threads = Array.from({ length: count - 1 }, () => new Connection(newWorker()));
    await Promise.all(this.#threads.map((thread) => thread.ask("load", shared)));
    // It is answered only if the thread stops. The engine then waits for it in vain.
    for (const thread of this.#threads) thread.ask("runThread").catch(({ message }) => this.#broken(message));
    await this.ask("startThreads", { count });
  }

  /** Asks the worker; `transfer` is handed over and no longer usable here. */
  ask(request, rest = {}, transfer = []) {
    if (this.#failure) return Promise.reject(this.#failure);
    return new Promise((resolve, reject) => {
      const id = this.#next++;
      this.#waiting.set(id, { resolve, reject });
      this.#worker.postMessage({ id, request, ...rest }, transfer);
    });
  }

  /** The page has shown what the worker reported last, and takes more. */
  taken() {
    this.#worker.postMessage({ taken: true });
  }

  /** Ends the worker. What waits for an answer fails with `closed`, which is no news to the visitor. */
  close(why = "the engine was closed") {
    for (const thread of this.#threads) thread.close();
    this.#worker.onmessage = this.#worker.onerror = null;
    this.#worker.terminate();
    this.#failure ??= Object.assign(new Error(why), { closed: true });
    for (const { reject } of this.#waiting.values()) reject(this.#failure);
    this.#waiting.clear();
  }

  #broken(error) {
    if (this.#failure) return;
    this.close(error);
    if (this.opened) this.#onEvent({ event: "failure", error, fatal: true }, this);
  }
}
