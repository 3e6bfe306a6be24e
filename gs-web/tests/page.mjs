// Tests the built page in headless Chromium, and compares what it computes with the program gs.
//
// node page.mjs BROWSER PAGE GS PLACE [PARTS [NAME]]: as in browser.mjs; only the tests of PARTS, as in
// `fit,view`, and only those whose name matches NAME, a regular expression.

import { close } from "./browser.mjs";
import * as fit from "./fit.mjs";
import { runTests } from "./runner.mjs";
import * as serve from "./serve.mjs";
import * as threads from "./threads.mjs";
import * as trouble from "./trouble.mjs";
import * as view from "./view.mjs";

const all = { fit, threads, view, trouble, serve };
const [parts = Object.keys(all).join(), name] = process.argv.slice(6);
const unknown = parts.split(",").find((part) => !(part in all));
if (unknown) {
  console.error(`there is no part ${unknown}: ${Object.keys(all).join(", ")}`);
  process.exit(2);
}
await runTests(Object.assign({}, ...parts.split(",").map((part) => all[part].tests)), name, close);
