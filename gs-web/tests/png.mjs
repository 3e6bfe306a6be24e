// PNG files: written for tests, and read where gs has written them.

import assert from "node:assert/strict";
import zlib from "node:zlib";

/** A PNG of 8-bit RGB whose bytes `row(y)` gives line by line. */
export function encoded(width, height, row) {
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([8, 2], 8);
  const lines = Array.from({ length: height }, (_, y) => Buffer.concat([Buffer.of(0), row(y)]));
  return file(header, zlib.deflateSync(Buffer.concat(lines)));
}

/** A PNG of one grey bit for each pixel, all of them black: large sides in a small file. */
export function black(width, height) {
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([1, 0], 8);
  return file(header, zlib.deflateSync(Buffer.alloc(height * (1 + Math.ceil(width / 8)))));
}

function file(header, data) {
  const parts = [["IHDR", header], ["IDAT", data], ["IEND", Buffer.alloc(0)]].map(([name, content]) => {
    const part = Buffer.concat([Buffer.alloc(4), Buffer.from(name, "latin1"), content, Buffer.alloc(4)]);
    part.writeUInt32BE(content.length, 0);
    part.writeUInt32BE(crc32(part.subarray(4, -4)), part.length - 4);
    return part;
  });
  return Buffer.concat([Buffer.from("\x89PNG\r\n\x1a\n", "latin1"), ...parts]);
}

function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) {
    crc ^= byte;
    for (let k = 0; k < 8; k++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return (crc ^ 0xffffffff) >>> 0;
}

/** The RGB bytes of a PNG that gs has written. */
export function decoded(png) {
  const [width, height] = [png.readUInt32BE(16), png.readUInt32BE(20)];
  assert.deepEqual([png[24], png[25]], [8, 2], "8 bits, RGB");
  const parts = [];
  for (let k = 8; k < png.length; k += 12 + png.readUInt32BE(k)) {
    if (png.toString("latin1", k + 4, k + 8) === "IDAT") parts.push(png.subarray(k + 8, k + 8 + png.readUInt32BE(k)));
  }
  const raw = zlib.inflateSync(Buffer.concat(parts));
  const [line, out] = [3 * width, Buffer.alloc(3 * width * height)];
  const paeth = (a, b, c) => {
    const [x, y, z] = [a, b, c].map((value) => Math.abs(a + b - c - value));
    return x <= y && x <= z ? a : y <= z ? b : c;
  };
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < line; x++) {
      const left = x >= 3 ? out[y * line + x - 3] : 0;
      const above = y > 0 ? out[(y - 1) * line + x] : 0;
      const corner = x >= 3 && y > 0 ? out[(y - 1) * line + x - 3] : 0;
      const add = [0, left, above, (left + above) >> 1, paeth(left, above, corner)][raw[y * (line + 1)]];
      out[y * line + x] = raw[y * (line + 1) + 1 + x] + add;
    }
  }
  return out;
}
