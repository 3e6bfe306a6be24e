// Tests the built page in headless Chromium, and compares what it computes with the program gs.
//
// node page.mjs BROWSER PAGE GS PLACE [NAME]: as in browser.mjs; with NAME, a regular expression, only
// the tests whose name matches it.

import { close } from "./browser.mjs";
import * as fit from "./fit.mjs";
import { runTests } from "./runner.mjs";
import * as serve from "./serve.mjs";
import * as threads from "./threads.mjs";
import * as trouble from "./trouble.mjs";
import * as view from "./view.mjs";

const tests = Object.assign({}, ...[fit, threads, view, trouble, serve].map(({ tests }) => tests));
await runTests(tests, process.argv[6], close);
