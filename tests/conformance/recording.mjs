// Reads the frames of a recording being written, using only docs/recording_format.md.

import { readFileSync } from "node:fs";

import { decode } from "@msgpack/msgpack";

const TABLE = Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value >>> 0;
});

function crc32(bytes) {
  let value = 0xffffffff;
  for (const byte of bytes) value = TABLE[(value ^ byte) & 0xff] ^ (value >>> 8);
  return (value ^ 0xffffffff) >>> 0;
}

/** All whole frames of a file; what is cut off at its end is left out. */
export function recording({ path }) {
  const file = readFileSync(path);
  if (file.toString("latin1", 0, 4) !== "RBTL") throw new Error("not a recording");
  const frames = [];
  const head = 12;
  let position = 5;
  while (position + head <= file.length) {
    const size = file.readUInt32LE(position);
    if (crc32(file.subarray(position, position + 8)) !== file.readUInt32LE(position + 8)) {
      throw new Error(`byte ${position}: the checksum of the length does not match`);
    }
    const payload = file.subarray(position + head, position + head + size);
    if (payload.length < size) break;
    if (crc32(payload) !== file.readUInt32LE(position + 4)) {
      throw new Error(`byte ${position}: the checksum does not match`);
    }
    frames.push(decode(payload));
    position += head + size;
  }
  return { version: file[4], frames };
}
