// Times the decoder of the npm package in Node and in headless Chromium, on images as .gsi files.
//
// node gs-web/benches/gsi.mjs chromium target/web-package/gaussian-splats-0.1.0.tgz target/release/gs target/web-test IMAGE...
//
// Each image is encoded at 0.5 bits per pixel and decoded 21 times; the first times, in which the module is
// loaded and compiled, are left out.

import { execFileSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { at, close, launch, run } from "../tests/browser.mjs";

const TIMES = 21;
const [archive, images] = [path.resolve(process.argv[3]), process.argv.slice(6)];
const site = at("site");
fs.mkdirSync(site);
fs.writeFileSync(path.join(site, "package.json"), '{ "private": true, "type": "module" }');
execFileSync("npm", ["install", "--ignore-scripts", "--no-audit", "--no-fund", "--offline", archive], { cwd: site, stdio: "pipe" });
const decoder = "node_modules/gaussian-splats/gsi.js";

const server = http.createServer(({ url }, response) => {
  const file = path.join(site, new URL(url, "http://localhost").pathname);
  const type = { ".js": "text/javascript", ".wasm": "application/wasm" }[path.extname(file)] ?? "text/html";
  if (!fs.existsSync(file) || !fs.statSync(file).isFile()) return response.writeHead(200, { "content-type": type }).end();
  response.writeHead(200, { "content-type": type }).end(fs.readFileSync(file));
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));

/** Times of decoding, ms; it also runs in the browser, where `decode` comes from another place. */
async function timed(decode, bytes, times) {
  const taken = [];
  for (let k = 0; k < times + 3; k++) {
    const started = performance.now();
    await decode(bytes);
    if (k >= 3) taken.push(performance.now() - started);
  }
  return taken.sort((a, b) => a - b);
}

const summary = (taken) => `${taken[taken.length >> 1].toFixed(1)} (${taken[0].toFixed(1)} to ${taken.at(-1).toFixed(1)})`;
const { decode } = await import(pathToFileURL(path.join(site, decoder)));
const browser = await launch();
const page = await browser.newPage();
await page.goto(`http://localhost:${server.address().port}/`);
console.log("image, bytes, ms in Node: median (least to most), ms in Chromium");
for (const image of images) {
  const file = path.join(site, `${path.parse(image).name}.gsi`);
  run("encode", image, "-o", file, "--bpp", "0.5", "--backend", "cpu");
  const bytes = fs.readFileSync(file);
  const inNode = await timed(decode, bytes, TIMES);
  const inPage = await page.evaluate(
    async (source, decoder, name, times) => {
      const timed = new Function(`return ${source}`)();
      const { decode } = await import(`/${decoder}`);
      return timed(decode, new Uint8Array(await (await fetch(`/${name}`)).arrayBuffer()), times);
    },
    timed.toString(), decoder, path.basename(file), TIMES);
  console.log(`${path.basename(image)}, ${bytes.length}, ${summary(inNode)}, ${summary(inPage)}`);
}
server.close();
await browser.close();
await close();
process.exit();
