// The page's side of the worker: requests as promises, events as a callback.

/** The engine in a worker. */
export class Connection {
  #worker;
  #waiting = new Map();
  #next = 1;
  #failure;

  constructor(worker, onEvent) {
    this.#worker = worker;
    worker.onmessage = ({ data }) => {
      if (data.event) return onEvent(data);
      const { resolve, reject } = this.#waiting.get(data.id);
      this.#waiting.delete(data.id);
      if ("error" in data) reject(Object.assign(new Error(data.error), { fatal: data.fatal }));
      else resolve(data.result);
    };
    worker.onerror = (event) => this.#fail(event.message ?? "the worker of the page did not start");
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

  close() {
    this.#worker.terminate();
    this.#fail("the engine was closed", { closed: true });
  }

  #fail(message, kind = { fatal: true }) {
    this.#failure = Object.assign(new Error(message), kind);
    for (const { reject } of this.#waiting.values()) reject(this.#failure);
    this.#waiting.clear();
  }
}
