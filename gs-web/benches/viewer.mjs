// Draws a SOG that gs has written with the PlayCanvas engine, another program, and compares the picture
// with that of gs render from the same camera.
//
// npm install --prefix target/web-test --no-save --ignore-scripts playcanvas@2.23.3
// node gs-web/benches/viewer.mjs chromium target/page target/release/gs target/web-test SCENE.ply
//   '{"position": [0, 0, -4], "target": [0, 0, 0]}'

import assert from "node:assert/strict";
import fs from "node:fs";
import http from "node:http";
import path from "node:path";
import { at, close, launch, place, psnr, report, run } from "../tests/browser.mjs";

const [SIZE, FOV] = [[640, 480], 50];
const [scene, key] = process.argv.slice(6);
const { position, target } = JSON.parse(key);
run("convert", scene, at("other.sog"));
fs.writeFileSync(at("camera.json"), JSON.stringify({ width: SIZE[0], height: SIZE[1], fov: FOV, up: [0, -1, 0], frames: 1, keys: [{ position, target }] }));
run("render", at("other.sog"), "--path", at("camera.json"), "-o", at("other.png"), "--backend", "cpu");

const engine = path.join(path.resolve(place), "node_modules/playcanvas/build/playcanvas.mjs");
const files = { "/": Buffer.from(`<canvas id="canvas" width="${SIZE[0]}" height="${SIZE[1]}"></canvas>`), "/playcanvas.mjs": fs.readFileSync(engine), "/other.sog": fs.readFileSync(at("other.sog")) };
const server = http.createServer(({ url }, response) => {
  response.writeHead(files[url] ? 200 : 404, { "content-type": url.endsWith("mjs") ? "text/javascript" : url === "/" ? "text/html" : "application/octet-stream" });
  response.end(files[url]);
});
await new Promise((resolve) => server.listen(0, "localhost", resolve));

const browser = await launch("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader");
const page = await browser.newPage();
page.on("console", (message) => report("console:", message.text()));
page.on("pageerror", (error) => report("error:", error.message));
await page.goto(`http://localhost:${server.address().port}/`);
const text = await page.evaluate(async (position, target, fov) => {
  const pc = await import("/playcanvas.mjs");
  const canvas = document.getElementById("canvas");
  const app = new pc.Application(canvas, { graphicsDeviceOptions: { antialias: false, alpha: false, preserveDrawingBuffer: true } });
  app.start();
  const asset = new pc.Asset("scene", "gsplat", { url: "/other.sog" });
  app.assets.add(asset);
  await new Promise((resolve, reject) => {
    asset.ready(resolve);
    asset.on("error", (error) => reject(new Error(error)));
    app.assets.load(asset);
  });
  const splats = new pc.Entity("splats");
  splats.addComponent("gsplat", { asset });
  app.root.addChild(splats);
  const camera = new pc.Entity("camera");
  camera.addComponent("camera", { clearColor: new pc.Color(0, 0, 0), fov, horizontalFov: true, nearClip: 0.01, farClip: 10_000 });
  app.root.addChild(camera);
  camera.setPosition(...position);
  camera.lookAt(new pc.Vec3(...target), new pc.Vec3(0, -1, 0));
  for (let k = 0; k < 60; k++) {
    app.renderNextFrame = true;
    await new Promise((resolve) => app.once("frameend", resolve));
  }
  const [width, height] = [canvas.width, canvas.height];
  const copy = new OffscreenCanvas(width, height).getContext("2d");
  copy.drawImage(canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, width, height);
  let text = "";
  for (let k = 0; k < data.length; k += 32768) text += String.fromCharCode(...data.subarray(k, k + 32768));
  return `${width} ${height} ${btoa(text)}`;
}, position, target, FOV);
await page.screenshot({ path: path.join(place, "playcanvas.png") });
const [width, height, pixels] = text.split(" ");
assert.deepEqual([Number(width), Number(height)], SIZE);
report("PSNR of PlayCanvas's picture against gs render's, dB", psnr(Buffer.from(pixels, "base64"), fs.readFileSync(at("other.png"))));
await browser.close();
server.close();
await close();
