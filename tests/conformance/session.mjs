// A client of the protocol by Node's `ws` and an independent MessagePack; it keeps all it hears.

import { decode, encode } from "@msgpack/msgpack";
import { WebSocket } from "ws";

const PATIENCE = 20_000;

export const JSON_PROTOCOL = "robotouille.v1.json";
export const MSGPACK_PROTOCOL = "robotouille.v1.msgpack";

export class Session {
  /** Connects, and waits until the connection is open. */
  static async open(url, subprotocols, options = {}) {
    const socket = new WebSocket(url, subprotocols, options);
    const session = new Session(socket);
    await within(
      new Promise((resolve, reject) => {
        socket.on("open", resolve);
        socket.on("error", reject);
      }),
      "the handshake",
    );
    session.text = socket.protocol !== MSGPACK_PROTOCOL;
    return session;
  }

  constructor(socket) {
    this.socket = socket;
    this.text = true;
    this.heard = [];
    this.sent = [];
    this.position = 0;
    this.wake = () => {};
    this.closed = new Promise((resolve) => {
      socket.on("close", (code, reason) => resolve({ code, reason: reason.toString() }));
    });
    socket.on("message", (data, binary) => this.hear(data, binary));
    socket.on("close", () => this.wake());
    socket.on("error", () => {});
  }

  hear(data, binary) {
    const message = binary ? decode(data) : JSON.parse(data.toString());
    this.heard.push({ binary, message, raw: binary ? data.toString("base64") : data.toString() });
    this.wake();
  }

  /** What a message is on the wire of this connection. */
  pack(message) {
    return this.text ? JSON.stringify(message) : encode(message);
  }

  send(message) {
    this.sent.push(message);
    this.socket.send(this.pack(message));
  }

  /** The next message of one of these types; others are passed over. */
  async expect(...types) {
    for (;;) {
      while (this.position < this.heard.length) {
        const { message } = this.heard[this.position++];
        if (types.includes(message.type)) return message;
      }
      const news = new Promise((resolve) => (this.wake = resolve));
      if (this.socket.readyState >= WebSocket.CLOSING) throw new Error(`closed, no ${types}`);
      await within(news, `one of ${types}`);
    }
  }

  async ask(message, ...types) {
    this.send(message);
    return this.expect(...types, "error");
  }

  async hello(name, more = {}) {
    return this.ask({ type: "hello", protocol: 1, name, kind: "bot", ...more }, "welcome");
  }

  /** Everything sent before this was dealt with, and its consequences for us are heard. */
  async settle() {
    const ref = 1_000_000 + this.sent.length;
    this.send({ type: "join", episode: "none-such", ref });
    for (;;) {
      const answer = await this.expect("error");
      if (answer.ref === ref) return;
    }
  }

  async close(code = 1000, reason = "") {
    this.socket.close(code, reason);
    return within(this.closed, "the closing handshake");
  }
}

export function within(promise, what) {
  let timer;
  const late = new Promise((_, reject) => {
    timer = setTimeout(() => reject(new Error(`waited in vain for ${what}`)), PATIENCE);
  });
  return Promise.race([promise, late]).finally(() => clearTimeout(timer));
}
