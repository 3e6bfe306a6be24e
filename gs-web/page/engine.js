// The page's side of the worker: requests as promises, events as a callback.

/** The engine in a worker. `onEvent` gets what it says unasked, and `failure` if the worker breaks. */
export class Connection {
  /** Whether the engine has been opened: what fails before that is an answer, not an event. */
  opened = false;
  #worker;
  #waiting = new Map();
  #next = 1;
  #failure;

  constructor(worker, onEvent) {
    this.#worker = worker;
    worker.onmessage = ({ data }) => {
      if (data.event) return onEvent(data, this);
      const { resolve, reject } = this.#waiting.get(data.id);
      this.#waiting.delete(data.id);
      if ("error" in data) reject(Object.assign(new Error(data.error), { fatal: data.fatal }));
      else resolve(data.result);
    };
    worker.onerror = (event) => {
      event.preventDefault();
      const error = event.message ?? "the worker of the page did not start";
      this.close(error);
      if (this.opened) onEvent({ event: "failure", error, fatal: true }, this);
    };
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
    this.#worker.onmessage = this.#worker.onerror = null;
    this.#worker.terminate();
    this.#failure ??= Object.assign(new Error(why), { closed: true });
    for (const { reject } of this.#waiting.values()) reject(this.#failure);
    this.#waiting.clear();
  }
}
