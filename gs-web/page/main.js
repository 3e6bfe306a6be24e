// The page: tabs, files that are dropped, messages, and the engine's start.

import { Connection } from "./engine.js";
import { FitPanel } from "./fit.js";
import { engineParts } from "./parts.js";
import { watchServer } from "./serve.js";
import { threadsWanted, threadWords } from "./threads.js";
import { ViewPanel } from "./view.js";

const $ = (id) => document.getElementById(id);
const status = $("status");
const problem = $("problem");

const page = {
  connection: undefined,
  /** Done when the last file that was given is open, or refused. */
  opening: undefined,
  /** Asks the engine; a failure is shown and thrown on. */
  async ask(request, rest, transfer) {
    try {
      return await (await page.connection).ask(request, rest, transfer);
    } catch (error) {
      fail(error);
      throw error;
    }
  },
  say(text) {
    status.textContent = text;
  },
  fail,
};

function fail(error) {
  if (error.closed) return;
  problem.textContent = error.message;
  problem.hidden = false;
  if (!error.fatal) return;
  // What stopped on the CPU would probably stop there again, so going on is left to the visitor.
  const running = fit.running && document.body.dataset.backend !== "cpu";
  problem.textContent += `. The engine starts again on the CPU, ${running ? "and goes on" : "paused,"} from its last checkpoint.`;
  $("backend").value = "cpu";
  connect(running);
}

const fit = new FitPanel(page);
const view = new ViewPanel(page);
// For tests and for the console.
globalThis.gsPage = Object.assign(page, { fit, view });

/** Starts the engine in a new worker; `running` says whether a fit goes on at once. */
function connect(running) {
  page.connection?.then((connection) => connection.close(), () => {});
  page.connection = (async () => {
    let threads = threadsWanted();
    const connection = await loaded(threads.count).catch((error) => {
      if (threads.count === 1) throw error;
      threads = { count: 1, why: `others did not start (${error.message})` };
      return loaded(1);
    });
    const wanted = $("backend").value;
    const opened = await connection.ask("open", { wanted }).catch(async (error) => {
      if (wanted !== "wgpu") throw error;
      fail(new Error(`${error.message}; the CPU computes instead`));
      return connection.ask("open", { wanted: "cpu" });
    });
    for (const [slot, id] of Object.entries({ a: "canvas-a", b: "canvas-b", view: "canvas-view" })) {
      const before = await createImageBitmap($(id)).catch(() => undefined);
      const canvas = fresh($(id)).transferControlToOffscreen();
      await connection.ask("canvas", { slot, canvas, before }, before ? [canvas, before] : [canvas]);
    }
    const { name, reason, policies } = opened;
    status.textContent = `Computing on ${reason}; ${threadWords({ ...threads, count: opened.threads })}`;
    document.body.dataset.backend = name;
    return Object.assign(connection, { policies, opened: true });
  })();
  page.connection.then(
    ({ policies }) => {
      fit.ready(policies, running).catch(() => {});
      view.ready().catch(() => {});
    },
    (error) => {
      problem.textContent = `The engine did not start: ${error.message}. Reload the page, or use another browser.`;
      problem.hidden = false;
    },
  );
}

/** A new engine with this number of threads. */
async function loaded(threads) {
  const { newWorker, wasm } = await engineParts(threads);
  const connection = new Connection(newWorker(), (event, connection) => {
    if (event.event === "levels") view.levels(event);
    else fit.event(event, connection);
  });
  try {
    await connection.load(wasm, threads, newWorker);
    return connection;
  } catch (error) {
    connection.close();
    throw error;
  }
}

/** A canvas can be handed over once only, so a new one takes its place. */
function fresh(canvas) {
  if (!canvas.dataset.used) {
    canvas.dataset.used = "yes";
    return canvas;
  }
  const copy = canvas.cloneNode();
  canvas.replaceWith(copy);
  view.moved(copy);
  return copy;
}

/** Shows a tab's panel. */
function choose(tab) {
  for (const other of document.querySelectorAll("[role=tab]")) {
    const chosen = other === tab;
    other.setAttribute("aria-selected", chosen);
    other.tabIndex = chosen ? 0 : -1;
    $(other.getAttribute("aria-controls")).hidden = !chosen;
  }
  if (tab.id === "tab-view") view.draw();
}

for (const tab of document.querySelectorAll("[role=tab]")) {
  tab.addEventListener("click", () => choose(tab));
  tab.addEventListener("keydown", ({ key }) => {
    if (key !== "ArrowLeft" && key !== "ArrowRight") return;
    const other = tab.id === "tab-fit" ? $("tab-view") : $("tab-fit");
    choose(other);
    other.focus();
  });
}

/** Opens a file that was dropped, pasted or chosen: an image is fitted, everything else is a scene. */
async function open(file) {
  problem.hidden = true;
  if (file.type.startsWith("image/") && !/\.gsi$/i.test(file.name)) {
    choose($("tab-fit"));
    await fit.open(file);
  } else {
    choose($("tab-view"));
    await view.open(file);
  }
}

function openAll([file]) {
  if (file) page.opening = open(file).catch((error) => error.fatal || fail(error));
}
addEventListener("dragover", (event) => {
  event.preventDefault();
  $("drop").hidden = false;
});
addEventListener("dragleave", (event) => ($("drop").hidden = event.relatedTarget === null));
addEventListener("drop", (event) => {
  event.preventDefault();
  $("drop").hidden = true;
  openAll(event.dataTransfer.files);
});
addEventListener("paste", (event) => openAll(event.clipboardData.files));
for (const [button, input] of [["choose-image", "image"], ["choose-scene", "scene"]]) {
  $(button).addEventListener("click", () => $(input).click());
  $(input).addEventListener("change", () => {
    openAll($(input).files);
    $(input).value = "";
  });
}

$("backend").addEventListener("change", () => {
  problem.hidden = true;
  connect(fit.running);
});
const darkness = matchMedia("(prefers-color-scheme: dark)");
darkness.addEventListener("change", () => fit.drawCurves());
$("theme").addEventListener("click", () => {
  const now = document.documentElement.dataset.theme ?? (darkness.matches ? "dark" : "light");
  document.documentElement.dataset.theme = now === "dark" ? "light" : "dark";
  fit.drawCurves();
});

const wanted = new URLSearchParams(location.search);
if (wanted.has("backend")) $("backend").value = wanted.get("backend");
connect();
view.openEmbedded(() => choose($("tab-view")));
if (wanted.has("scene")) {
  choose($("tab-view"));
  page.opening = view.fetched(wanted.get("scene")).catch((error) => error.shown || fail(error));
}
watchServer(page, view, () => choose($("tab-view"))).catch(fail);
