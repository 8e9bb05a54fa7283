// The conversation with a server: greeting, reconnects, redirects. See docs/protocol.md.

/**
 * @typedef {Record<string, any> & {type: string}} Message
 * @typedef {{name: string, token?: string, resume?: string}} Identity
 * @typedef {{
 *   message: (message: Message) => void,
 *   status: (status: "connecting" | "online" | "offline" | "closed") => void,
 *   farewell: (code: string, reason: string) => void,
 *   resume: (token: string) => void,
 * }} Listener
 */

const SUBPROTOCOL = "robotouille.v1.json";
const FIRST_DELAY = 0.2;
const LONGEST_DELAY = 5;
// Another node takes games over three to eight seconds after a failure.
const EARLY_ATTEMPTS = 12;
const LONGEST_EARLY_DELAY = 1.5;
const ANSWER_SECONDS = 10;
const TICK_SECONDS = 2;
// A pause of the page's timers that shows that the machine was asleep: its connection is dead.
// Browsers run the timers of hidden pages once a minute.
const ASLEEP_SECONDS = 100;
const MAX_MOVES = 4;
// Silence of a game in real time after which its connection counts as lost.
const SILENT_SECONDS = 10;
// Redirects count as one round until the conversation has lasted this long.
const SETTLED_SECONDS = 1;

/** Codes that make a resume token useless. */
const TOKEN_CODES = new Set(["auth/expired", "auth/invalid", "auth/required", "auth/revoked"]);
/** Codes of errors after which the same request may succeed. */
const TEMPORARY_CODES = new Set(["server/handover", "server/recording", "rate/limited"]);

/** A participant's conversation with a server, over any number of connections. */
export class Connection {
  /**
   * @param {string} url
   * @param {Identity} identity
   * @param {Message} join The message that enters the episode.
   * @param {() => object | null} seen The part of the episode that the page already has.
   * @param {Listener} listener
   */
  constructor(url, identity, join, seen, listener) {
    this.url = url;
    this.home = url;
    this.identity = identity;
    this.join = join;
    this.seen = seen;
    this.listener = listener;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.joined = false;
    /** True if the session has been in the episode. */
    this.entered = identity.resume !== undefined;
    /** True if the server has continued the earlier session. */
    this.resumed = false;
    this.closed = false;
    this.failures = 0;
    this.moves = 0;
    this.openedAt = 0;
    this.heardAt = 0;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.tickedAt = Date.now();
    this.ticker = setInterval(() => this.tick(), TICK_SECONDS * 1000);
    this.onOnline = () => this.connectNow();
    this.onOffline = () => this.lost();
    addEventListener("online", this.onOnline);
    addEventListener("offline", this.onOffline);
    this.connect();
  }

  get online() {
    return this.joined && this.socket?.readyState === WebSocket.OPEN;
  }

  /** Send a message; return false without a conversation. @param {Message} message */
  send(message) {
    if (!this.online) return false;
    this.socket?.send(JSON.stringify(message));
    return true;
  }

  /** Close for good. */
  close() {
    this.closed = true;
    clearTimeout(this.timer);
    clearInterval(this.ticker);
    removeEventListener("online", this.onOnline);
    removeEventListener("offline", this.onOffline);
    this.drop();
    this.listener.status("closed");
  }

  /** Try to connect without waiting longer. */
  connectNow() {
    if (this.closed || this.socket) return;
    clearTimeout(this.timer);
    this.connect();
  }

  connect() {
    this.listener.status("connecting");
    let socket;
    try {
      socket = new WebSocket(this.url, SUBPROTOCOL);
    } catch {
      this.lost();
      return;
    }
    this.socket = socket;
    this.timer = setTimeout(() => this.lost(), ANSWER_SECONDS * 1000);
    socket.onopen = () => this.greet();
    socket.onmessage = (event) => {
      if (socket === this.socket) this.take(event.data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lost();
    };
  }

  greet() {
    this.openedAt = Date.now();
    const { name, token, resume } = this.identity;
    /** @type {Message} */
    const hello = { type: "hello", protocol: 1, name, kind: "human" };
    if (resume) {
      hello.resume = resume;
      hello.view = "state";
      const seen = this.seen();
      if (seen) hello.seen = seen;
    } else if (token) {
      hello.token = token;
    }
    this.socket?.send(JSON.stringify(hello));
  }

  /** @param {unknown} data */
  take(data) {
    this.heardAt = Date.now();
    /** @type {Message} */
    let message;
    try {
      message = JSON.parse(String(data));
    } catch {
      this.end("message/invalid", "");
      return;
    }
    if (message === null || typeof message !== "object") return;
    if (message.type === "welcome") this.welcome(message);
    else if (message.type === "moved") this.moved(message);
    else if (message.type === "bye") this.bye(message);
    else if (message.type === "error" && !this.joined) this.refused(message);
    else this.pass(message);
  }

  /** @param {Message} message */
  pass(message) {
    if (message.type === "left" && !this.joined) {
      // The session is known, but has lost its seat, for example to another browser.
      this.resumed = false;
      this.socket?.send(JSON.stringify(this.join));
      return;
    }
    if (message.type === "joined") {
      this.joined = this.entered = true;
      this.moves = 0;
      clearTimeout(this.timer);
      if (typeof message.resume === "string") this.keep(message.resume);
      this.join = { ...this.join, episode: message.code };
      if (message.seat) this.join.seat = message.seat;
      this.failures = 0;
      this.listener.message(message);
      this.listener.status("online");
      return;
    }
    // A join that was repeated because only its answer was lost.
    if (message.type === "error" && message.code === "episode/joined") return;
    this.listener.message(message);
  }

  /** @param {Message} message */
  welcome(message) {
    this.keep(String(message.resume));
    this.resumed = message.resumed === true;
    // The answer to a resume continues with `joined`. Otherwise the server has forgotten us, or the
    // join was lost with the last connection.
    if (!message.resumed || !this.entered) this.socket?.send(JSON.stringify(this.join));
  }

  /** @param {string} token */
  keep(token) {
    this.identity = { ...this.identity, resume: token };
    this.listener.resume(token);
  }

  /** @param {Message} message */
  refused(message) {
    const code = String(message.code);
    if (this.identity.resume && TOKEN_CODES.has(code)) {
      this.identity = { ...this.identity, resume: undefined };
      this.greet();
    } else if (TEMPORARY_CODES.has(code)) {
      this.lost();
    } else {
      this.end(code, String(message.message));
    }
  }

  /** @param {Message} message */
  moved(message) {
    this.moves = Date.now() - this.openedAt > SETTLED_SECONDS * 1000 ? 1 : this.moves + 1;
    const next = redirected(this.url, message);
    const moves = this.moves;
    if (next === null || moves > MAX_MOVES) {
      this.lost();
      return;
    }
    this.url = next;
    this.drop();
    this.connect();
  }

  /** @param {Message} message */
  bye(message) {
    if (message.retry) this.lost();
    else this.end(String(message.code), String(message.reason));
  }

  /** @param {string} code @param {string} reason */
  end(code, reason) {
    this.close();
    this.listener.farewell(code, reason);
  }

  drop() {
    clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = null;
    this.joined = false;
    socket?.close();
  }

  lost() {
    if (this.closed) return;
    this.drop();
    this.listener.status("offline");
    this.failures += 1;
    this.moves = 0;
    // A node that has failed may have passed the episode on: the first address finds it.
    if (this.failures % 3 === 0) this.url = this.home;
    const longest = this.failures <= EARLY_ATTEMPTS ? LONGEST_EARLY_DELAY : LONGEST_DELAY;
    const delay = Math.min(longest, FIRST_DELAY * 1.5 ** (this.failures - 1));
    this.timer = setTimeout(() => this.connect(), delay * (0.5 + Math.random() / 2) * 1000);
  }

  /**
   * Give the connection up if a game that sends every step has sent nothing for a while.
   * @param {number} atLeast
   */
  expectNews(atLeast) {
    const seconds = Math.max(SILENT_SECONDS, atLeast);
    if (this.online && Date.now() - this.heardAt > seconds * 1000) this.lost();
  }

  tick() {
    const now = Date.now();
    const asleep = now - this.tickedAt > ASLEEP_SECONDS * 1000;
    this.tickedAt = now;
    if (asleep && this.socket) {
      this.failures = 0;
      this.lost();
    }
  }
}

/**
 * Return the address that a `moved` message leads to; null if it must not be followed.
 * @param {string} from @param {Message} message
 */
export function redirected(from, message) {
  const here = new URL(from);
  try {
    if (message.url) {
      const there = new URL(message.url);
      const downgrade = here.protocol === "wss:" && there.protocol !== "wss:";
      return downgrade || !/^wss?:$/.test(there.protocol) ? null : there.href;
    }
    here.port = String(message.port);
    return here.href;
  } catch {
    return null;
  }
}

/** Return the address of the WebSocket next to a page. @param {string} page */
export function socketAddress(page) {
  const url = new URL("./", page);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  url.hash = url.search = "";
  return url.href;
}
