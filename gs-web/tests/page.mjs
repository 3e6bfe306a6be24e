// Tests the built page in headless Chromium, and compares what it computes with the program gs.
//
// node page.mjs BROWSER PAGE GS PLACE [NAME]: as in browser.mjs; with NAME, a regular expression, only
// the tests whose name matches it.

import { close } from "./browser.mjs";
import * as fit from "./fit.mjs";
import * as serve from "./serve.mjs";
import * as threads from "./threads.mjs";
import * as trouble from "./trouble.mjs";
import * as view from "./view.mjs";

const only = new RegExp(process.argv[6] ?? "");
let failed = 0;
for (const [name, test] of [fit, threads, view, trouble, serve].flatMap(({ tests }) => Object.entries(tests))) {
  if (!only.test(name)) continue;
  const started = Date.now();
  try {
    await test();
    console.log(`ok ${name} (${((Date.now() - started) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed += 1;
    console.log(`FAILED ${name}\n${error.stack}`);
  }
}
await close();
console.log(failed === 0 ? "all tests passed" : `${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
