// A copy of one episode, kept up to date by the server's messages.

import { now } from "./dom.js";
import { Task } from "../rules/task.js";
import { State } from "../rules/state.js";

/**
 * @typedef {import("./connection.js").Message} Message
 * @typedef {import("../rules/actions.js").Action} Action
 * @typedef {{player: string, name: string, kind: string, present: boolean, controller: string,
 *   ready: boolean}} Seat
 * @typedef {{seq: number, action: Action, step: number, at: number}} Sent
 * @typedef {{number: number, name: string, seat: string, text: string, intent: string,
 *   target: string}} Line
 * @typedef {{type: "answer", sent: Sent, applied: boolean, why: any[], reasons: string[]}} Answer
 * @typedef {{type: "task"} | {type: "step", jumped: boolean} | {type: "roster"} | Answer |
 *   {type: "said", line: Line, old: boolean} | {type: "notice", text: string} | {type: "ended"} |
 *   {type: "refused", code: string, message: string} | {type: "left", reason: string}} GameEvent
 */

// An unanswered action is sent again after this time: the server executes it once.
const REPEAT_SECONDS = 5;
// Dropped deltas after which a snapshot is requested again; a request may fall to a rate limit.
const RESYNC_EVERY = 20;

// Messages leave out fields with their default values.
const SEAT = { name: "", kind: "", present: false, controller: "", ready: true };
const WHY = { kind: "other", predicate: "", objects: [], expected: true };

/** One episode as this page knows it. */
export class Game {
  /**
   * @param {(message: Message) => boolean} send
   * @param {(event: GameEvent) => void} emit
   */
  constructor(send, emit) {
    this.send = send;
    this.emit = emit;
    this.episode = "";
    this.code = "";
    this.role = "player";
    /** @type {string | null} */
    this.me = null;
    /** @type {Task | null} */
    this.task = null;
    /** @type {State | null} */
    this.state = null;
    /** @type {State | null} The state one step earlier, if it is known. */
    this.before = null;
    this.step = 0;
    this.stepAt = 0;
    this.phase = "waiting";
    /** @type {Seat[]} */
    this.seats = [];
    /** @type {Record<string, any>} */
    this.clock = {};
    /** @type {{reason: string, left: number | null} | null} */
    this.pause = null;
    this.pausedAt = 0;
    /** When this page came into the waiting room. */
    this.waitingSince = now();
    /** @type {number | null} The end of the countdown. */
    this.startsAt = null;
    /** @type {string | null} */
    this.turn = null;
    /** @type {string[]} */
    this.waitsFor = [];
    this.rematch = "";
    /** @type {[number, number] | null} Largest numbers of steps for three and for two stars. */
    this.stars = null;
    /** @type {Record<string, any> | null} */
    this.outcome = null;
    this.said = 0;
    /** Number of the last chat message from before this page joined. */
    this.saidBefore = 0;
    this.seq = 0;
    /** @type {boolean | null} A declaration that could not be sent. */
    this.unsent = null;
    /** @type {Sent | null} The action that has no answer yet. */
    this.sent = null;
    this.skipped = 0;
    this.resyncing = false;
    /** @type {number | null} Step up to which the server sends what this page has missed. */
    this.catchUp = null;
    this.digest = "";
  }

  get running() {
    return this.phase === "running" && this.outcome === null;
  }

  /** Seconds of a step in real time; null if the clock waits for decisions. */
  get stepSeconds() {
    return this.clock.clock === "realtime" && this.clock.step_rate > 0
      ? 1 / this.clock.step_rate
      : null;
  }

  get seat() {
    return this.seats.find((seat) => seat.player === this.me) ?? null;
  }

  /** The field `seen` of `hello`. */
  seen() {
    if (!this.state) return null;
    return { episode: this.episode, step: this.step, said: this.said, stale: this.resyncing };
  }

  /** Send an action for the next step; it replaces one that has no answer yet. @param {Action} action */
  act(action) {
    if (!this.running || !this.me) return;
    const previous = this.sent;
    this.seq += 1;
    this.sent = { seq: this.seq, action, step: this.step, at: now() };
    if (previous) this.answer(previous, false, [{ kind: "superseded" }], []);
    this.repeat(true);
  }

  /** Send the unanswered action again, at once or when it is due. */
  repeat(atOnce = false) {
    const sent = this.sent;
    if (!sent || this.catchUp !== null) return;
    if (!atOnce && now() - sent.at < REPEAT_SECONDS) return;
    sent.at = now();
    const { action, seq, step } = sent;
    const named = { name: action.name, args: action.args };
    this.send({ type: "act", seq, action: named, basis: step });
  }

  /** Send the unanswered action again once the missed steps are here: they may have its answer. */
  caughtUp() {
    if (this.catchUp === null || this.step < this.catchUp) return;
    this.catchUp = null;
    this.repeat(true);
  }

  /** Send a chat message. @param {string} text */
  say(text) {
    return this.send({ type: "say", text });
  }

  /** @param {string} intent @param {string} target */
  signal(intent, target) {
    return this.send(target ? { type: "signal", intent, target } : { type: "signal", intent });
  }

  ready(/** @type {boolean} */ ready) {
    // A connection that is being lost sends nothing: `joined` repeats the declaration.
    this.unsent = this.send({ type: "ready", ready }) ? null : ready;
  }

  /** Take a message of the server. @param {Message} message */
  receive(message) {
    HANDLERS.get(message.type)?.(this, message);
  }

  /** @param {Message} message @param {boolean} resumed True if the session is the earlier one. */
  joined(message, resumed = false) {
    const kept = resumed && message.episode === this.episode && (message.seat ?? null) === this.me;
    // A new session has no record of earlier actions: repeating one could execute it twice.
    if (!kept && this.sent) this.answer(this.sent, false, [{ kind: "lost" }], []);
    this.saidBefore = message.said ?? 0;
    this.episode = message.episode;
    this.code = message.code;
    this.role = message.role;
    this.me = message.seat ?? null;
    this.seq = Math.max(this.seq, message.seq ?? 0);
    this.resyncing = false;
    this.catchUp = message.step ?? 0;
    if (this.unsent !== null) this.ready(this.unsent);
    this.caughtUp();
  }

  /** @param {Message} message */
  snapshot(message) {
    if (this.state && message.step < this.step) return;
    const first = this.task === null || (message.task && message.digest !== this.digest);
    if (message.task && first) {
      this.task = new Task(message.task);
      this.digest = message.digest;
    }
    if (!this.task) return;
    const jumped = !this.state || message.step !== this.step;
    this.before = null;
    this.state = State.fromSnapshot(this.task, message);
    this.step = message.step;
    this.stepAt = now();
    this.resyncing = false;
    this.clock = message.clock ?? {};
    this.outcome = message.outcome ?? null;
    this.roster(message);
    this.seq = Math.max(this.seq, message.seq ?? 0);
    if (first) this.emit({ type: "task" });
    if (this.sent && this.sent.seq === message.last_seq) {
      const reasons = message.last_reasons ?? [];
      this.answer(this.sent, reasons.length === 0, [], reasons);
    } else if (this.sent && this.sent.seq < (message.seq ?? 0) && this.sent.step < message.step) {
      this.answer(this.sent, false, [{ kind: "lost" }], []);
    }
    this.emit({ type: "step", jumped });
    this.caughtUp();
    if (this.outcome) this.emit({ type: "ended" });
  }

  /** @param {Message} message */
  delta(message) {
    if (!this.state || message.step <= this.step) return;
    if (this.resyncing || message.step !== this.step + 1) {
      this.resync();
      return;
    }
    const before = this.state;
    try {
      this.state = before.after(message);
    } catch {
      this.resync();
      return;
    }
    this.before = before;
    this.step = message.step;
    this.turn = message.turn ?? null;
    this.stepAt = now();
    this.settle(message);
    this.emit({ type: "step", jumped: false });
    this.caughtUp();
  }

  /** Read the answer to this page's action. @param {Message} message */
  settle(message) {
    const sent = this.sent;
    if (!sent) return;
    const index = this.task?.players.indexOf(this.me ?? "") ?? -1;
    const rows = message.did ?? [];
    for (let row = 0; row < rows.length; row += 1) {
      if (rows[row][0] !== index || (message.seq?.[row] ?? 0) < sent.seq) continue;
      const unmet = message.unmet?.[row] ?? [];
      this.answer(sent, unmet.length === 0, message.why?.[row] ?? [], unmet);
      return;
    }
  }

  /** @param {Sent} sent @param {boolean} applied @param {any[]} why @param {string[]} reasons */
  answer(sent, applied, why, reasons) {
    if (this.sent === sent) this.sent = null;
    const whole = why.map((each) => ({ ...WHY, ...each }));
    this.emit({ type: "answer", sent, applied, why: whole, reasons });
  }

  resync() {
    if (!this.resyncing || this.skipped >= RESYNC_EVERY) {
      this.resyncing = true;
      this.skipped = 0;
      this.send({ type: "resync" });
    }
    this.skipped += 1;
  }

  /** @param {Message} message */
  rejected(message) {
    const sent = this.sent;
    if (!sent || sent.seq !== message.seq) return;
    if (message.code === "rate/limited") {
      sent.at = now() - REPEAT_SECONDS + 0.25;
      return;
    }
    this.answer(sent, false, message.why ?? [], message.reasons ?? []);
  }

  /** @param {Message} message */
  roster(message) {
    this.phase = message.phase;
    this.turn = message.turn ?? null;
    this.seats = (message.seats ?? []).map((/** @type {any} */ seat) => ({ ...SEAT, ...seat }));
    const pause = message.pause ?? null;
    if (pause) this.pausedAt = now();
    this.pause = pause;
    this.startsAt = message.starts_in == null ? null : now() + message.starts_in;
    this.waitsFor = message.waits_for ?? [];
    if (message.rematch) this.rematch = message.rematch;
    this.emit({ type: "roster" });
  }

  /** @param {Message} message */
  chat(message) {
    const number = message.number ?? 0;
    // Messages come again after a reconnect.
    if (number && number <= this.said) return;
    this.said = Math.max(this.said, number);
    const { name, seat = "", text, intent = "", target = "" } = message;
    const line = { number, name, seat, text, intent, target };
    this.emit({ type: "said", line, old: number > 0 && number <= this.saidBefore });
  }

  /** @param {Message} message */
  ended(message) {
    this.outcome = message.outcome;
    this.phase = "ended";
    this.pause = null;
    if (this.sent) this.answer(this.sent, false, [], []);
    this.emit({ type: "ended" });
  }
}

/** @type {Map<string, (game: Game, message: Message) => void>} */
const HANDLERS = new Map([
  ["snapshot", (game, message) => game.snapshot(message)],
  ["delta", (game, message) => game.delta(message)],
  ["rejected", (game, message) => game.rejected(message)],
  ["roster", (game, message) => game.roster(message)],
  ["said", (game, message) => game.chat(message)],
  ["ended", (game, message) => game.ended(message)],
  ["notice", (game, { text }) => game.emit({ type: "notice", text: String(text) })],
  ["error", (game, { code, message }) => game.emit({ type: "refused", code, message })],
  ["left", (game, { reason = "" }) => game.emit({ type: "left", reason })],
]);
