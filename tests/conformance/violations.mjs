// Frames that break RFC 6455, over a bare TCP socket: the server must fail the connection.

import { createHash, randomBytes } from "node:crypto";
import { connect } from "node:net";

import { within } from "./session.mjs";

const ACCEPT = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";

/** A frame from its first two bytes, the rest of its head, a mask or none, and a payload. */
function frame(first, length, { mask = true, payload = Buffer.alloc(0), wide = null } = {}) {
  const key = mask ? randomBytes(4) : Buffer.alloc(0);
  const content = mask ? Buffer.from(payload.map((byte, i) => byte ^ key[i % 4])) : payload;
  const head = Buffer.from([first, (mask ? 0x80 : 0) | length]);
  return Buffer.concat([head, wide ?? Buffer.alloc(0), key, content]);
}

const text = Buffer.from('{"type":"list"}');
const whole = (first, options = {}) => frame(first, text.length, { payload: text, ...options });
const closing = (...bytes) => frame(0x88, bytes.length, { payload: Buffer.from(bytes) });

export const VIOLATIONS = {
  unmasked: [whole(0x81, { mask: false })],
  "reserved bit 1": [whole(0xc1)],
  "reserved bit 3": [whole(0x91)],
  "unknown opcode": [whole(0x83)],
  "unknown control opcode": [whole(0x8b)],
  "continuation of nothing": [whole(0x80)],
  "a new message inside a fragmented one": [whole(0x01), whole(0x81)],
  "fragmented ping": [frame(0x09, 1, { payload: Buffer.from("p") })],
  "ping of 126 bytes": [
    frame(0x89, 126, { wide: Buffer.from([0, 126]), payload: Buffer.alloc(126) }),
  ],
  "close frame of one byte": [closing(3)],
  "close code 1005": [closing(3, 0xed)],
  "close code 999": [closing(3, 0xe7)],
  "text that is not UTF-8": [frame(0x81, 2, { payload: Buffer.from([0xff, 0xfe]) })],
  "a length of 2^63 bytes": [frame(0x81, 127, { wide: Buffer.from("8000000000000000", "hex") })],
  "a length of 2^40 bytes": [frame(0x81, 127, { wide: Buffer.from("0000010000000000", "hex") })],
};

/** For each violation: the close code, and whether all that the server sent was unmasked. */
export async function violations({ url }) {
  const results = {};
  for (const [name, frames] of Object.entries(VIOLATIONS)) results[name] = await commit(url, frames);
  return results;
}

async function commit(url, frames) {
  const { hostname, port } = new URL(url);
  const socket = connect(Number(port), hostname);
  const chunks = [];
  const over = new Promise((resolve) => socket.on("close", resolve));
  socket.on("error", () => {});
  const answered = new Promise((resolve) => {
    socket.on("data", (chunk) => {
      chunks.push(chunk);
      if (Buffer.concat(chunks).includes("\r\n\r\n")) resolve();
    });
  });
  const key = randomBytes(16).toString("base64");
  socket.write(
    `GET / HTTP/1.1\r\nHost: ${hostname}:${port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n` +
      `Sec-WebSocket-Key: ${key}\r\nSec-WebSocket-Version: 13\r\n\r\n`,
  );
  await within(answered, "the handshake");
  for (const bytes of frames) socket.write(bytes);
  await within(over, "the server to close");
  const whole = Buffer.concat(chunks);
  const split = whole.indexOf("\r\n\r\n") + 4;
  const wanted = createHash("sha1").update(key + ACCEPT).digest("base64");
  return {
    accepted: whole.subarray(0, split).toString().toLowerCase().includes(wanted.toLowerCase()),
    ...readFrames(whole.subarray(split)),
  };
}

/** The last close code of a stream of short frames, and whether no frame was masked. */
function readFrames(stream) {
  let [position, code, unmasked] = [0, null, true];
  while (position + 2 <= stream.length) {
    const opcode = stream[position] & 0x0f;
    unmasked &&= (stream[position + 1] & 0x80) === 0;
    let size = stream[position + 1] & 0x7f;
    position += 2;
    if (size === 126) {
      size = stream.readUInt16BE(position);
      position += 2;
    }
    if (opcode === 8 && size >= 2) code = stream.readUInt16BE(position);
    position += size;
  }
  return { code, unmasked };
}
