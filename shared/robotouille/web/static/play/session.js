// One visit of a kitchen: connects the conversation, the game, the picture and the controls.

import { Kitchen } from "../kitchen/painter.js";
import { unserved } from "../rules/unserved.js";
import { taskTitle } from "../rules/words.js";
import { Bubbles } from "./bubbles.js";
import { Connection, socketAddress } from "./connection.js";
import { Cover, button, outcomeWords, slip, waiting } from "./covers.js";
import { byId, element, now, setText } from "./dom.js";
import { Game } from "./game.js";
import { Hands } from "./hands.js";
import { loadLook } from "./look.js";
import { Chat, showSeats } from "./panel.js";
import { nextAddress, obeyParent, tellParent } from "./parent.js";
import { keepSeat, seatKey, seatToken } from "./storage.js";
import { clock, text, unservedWords } from "./texts.js";
import { newTicket } from "./ticket.js";

/** @typedef {import("./connection.js").Message} Message */
/** @typedef {import("./game.js").GameEvent} GameEvent */
/**
 * @typedef {{code: string, name: string, watch: boolean, token?: string, agreed: string}} Visit
 *   `agreed` is the address of the information to which the player has agreed, until the recording
 *   has a note of it.
 */
/**
 * @typedef {{left: (fault: string) => void, moved: (code: string) => void, watch: () => void}} Exits
 */

const NOTICE_SECONDS = 4;
// Additional time for each letter of a notice.
const READING_SECONDS = 0.06;
// Beginning of a bot's announcement of its next actions (planning/policies/team_talk.py).
const INTENDS = "Next: ";
// The live region speaks at most this often, so that a screen reader can follow.
const SPOKEN_SECONDS = 1;

export class Session {
  /** @param {Visit} visit @param {Exits} exits */
  constructor(visit, exits) {
    this.visit = visit;
    this.exits = exits;
    this.key = seatKey(visit.code, visit.token);
    /** @type {Connection | null} */
    this.connection = null;
    /** @type {Map<number, {request: Message, settle: (answer: Message) => void}>} */
    this.asked = new Map();
    this.lastRef = 0;
    this.game = new Game((message) => this.connection?.send(message) ?? false, (e) => this.on(e));
    this.chat = new Chat();
    this.cover = new Cover(this.game, {
      ready: (ready) => this.game.ready(ready),
      rematch: () => this.rematch(),
      share: () => this.share(),
      // A personal link is for one game.
      mayRepeat: !visit.token,
      next: nextAddress(),
    });
    /** @type {Kitchen | null} */
    this.kitchen = null;
    /** @type {Hands | null} */
    this.hands = null;
    /** @type {ReturnType<typeof newTicket> | null} */
    this.ticket = null;
    /** @type {Bubbles | null} */
    this.bubbles = null;
    this.phase = "";
    this.noticeUntil = 0;
    this.spokenAt = 0;
    this.over = false;
    /** @type {Map<string, import("./game.js").Seat>} */
    this.known = new Map();
    this.abort = new AbortController();
  }

  start() {
    const { code, name, watch, token } = this.visit;
    byId("game").hidden = false;
    this.listen();
    /** @type {Message} */
    const join = watch
      ? { type: "join", episode: code, role: "spectator", view: "state" }
      : { type: "join", episode: code, view: "state", ready: false, agent: "browser" };
    const resume = watch ? undefined : seatToken(this.key);
    this.connection = new Connection(
      socketAddress(location.href), { name, token, resume }, join, () => this.game.seen(),
      {
        message: (message) => this.receive(message),
        status: (status) => this.connected(status),
        farewell: (reason, words) => this.farewell(reason, words),
        resume: (token) => this.game.code && !watch && keepSeat(this.key, token),
      },
    );
    const frame = () => {
      if (this.over) return;
      this.draw();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
    this.timer = setInterval(() => this.tick(), 250);
    const commands = { ready: () => this.game.ready(true), leave: () => this.leave(true) };
    obeyParent(commands, this.abort.signal);
  }

  listen() {
    const { signal } = this.abort;
    byId("say").addEventListener("submit", (event) => this.say(event), { signal });
    byId("leave-button").addEventListener("click", () => this.leave(), { signal });
    setText(byId("title"), this.visit.code);
    setText(byId("status"), text("connecting"));
  }

  // Messages

  /** @param {Message} message */
  receive(message) {
    const waits = message.ref == null ? undefined : this.asked.get(message.ref);
    if (waits) {
      this.asked.delete(message.ref);
      waits.settle(message);
    } else if (message.type === "joined") {
      this.game.joined(message, this.connection?.resumed);
      const { resume } = this.connection?.identity ?? {};
      if (this.game.role === "player") keepSeat(this.key, resume ?? null);
      if (this.game.me && this.visit.agreed) {
        this.connection?.send({ type: "note", topic: "consent", text: this.visit.agreed });
        this.visit.agreed = "";
      }
    } else {
      this.game.receive(message);
    }
  }

  /**
   * Send a request and return its answer, which may be an error.
   * @param {Message} message
   * @returns {Promise<Message>}
   */
  ask(message) {
    this.lastRef += 1;
    const request = { ...message, ref: this.lastRef };
    return new Promise((settle) => {
      this.asked.set(request.ref, { request, settle });
      this.connection?.send(request);
    });
  }

  /** Send the unanswered requests over a new connection; those that change something fail. */
  askAgain() {
    for (const [ref, { request, settle }] of this.asked) {
      if (request.type.startsWith("get_")) this.connection?.send(request);
      else {
        this.asked.delete(ref);
        settle({ type: "error", message: text("offline") });
      }
    }
  }

  /** @param {GameEvent} event */
  on(event) {
    if (event.type === "task") this.furnish().catch((error) => this.farewell("page/files", `${error}`));
    else if (event.type === "step") this.stepped();
    else if (event.type === "roster") this.roster();
    else if (event.type === "answer") this.answered(event);
    else if (event.type === "said") this.heard(event.line, event.old);
    else if (event.type === "notice") this.announce(event.text);
    else if (event.type === "ended") this.ended();
    else if (event.type === "refused") this.notify(event.message);
    else this.farewell("episode/left", event.reason);
  }

  /** Load the look of the kitchen, and draw it from now on. */
  async furnish() {
    const { task } = this.game;
    if (!task) return;
    const own = await this.ask({ type: "get_rendering" });
    this.game.stars = own.stars ?? null;
    const look = await loadLook(task, own, (message) => this.ask(message));
    if (this.over) return;
    const canvas = /** @type {HTMLCanvasElement} */ (byId("kitchen"));
    this.kitchen = new Kitchen(canvas, task, look, this.game.me);
    this.kitchen.fit();
    this.bubbles = new Bubbles(this.kitchen, byId("bubbles"));
    this.ticket = newTicket(this.game, look);
    this.hands = new Hands(this.game, this.kitchen, look, {
      notify: (/** @type {string} */ words) => this.notify(words),
      signal: this.abort.signal,
    });
    this.cover.purposes = this.hands.wording.purposes();
    this.show();
    this.roster();
  }

  // What the page shows

  show() {
    const { game, kitchen } = this;
    if (!kitchen || !game.state) return;
    kitchen.show(game.state, {
      step: game.step,
      before: game.before,
      stepSeconds: game.stepSeconds,
      receivedAt: game.stepAt,
      outcome: game.outcome,
    });
  }

  stepped() {
    const { game } = this;
    this.show();
    this.ticket?.update();
    this.hands?.stepped();
    this.progress();
    this.explainUnserved();
    tellParent("step", { step: game.step, points: game.state?.orders?.score });
    this.status();
  }

  /** Say why a dish that looks ready since the last step is not served. */
  explainUnserved() {
    const { before, state } = this.game;
    if (!before || !state || !this.hands) return;
    const { wording } = this.hands;
    const key = (/** @type {import("../rules/unserved.js").Unserved} */ { station, things }) =>
      [station, ...things].join(" ");
    const known = new Set(unserved(before, wording).map(key));
    for (const each of unserved(state, wording)) {
      if (known.has(key(each))) continue;
      this.notify(unservedWords(each));
      this.speak(unservedWords(each));
    }
  }

  progress() {
    const { game } = this;
    const { max_steps: limit = 0 } = game.clock;
    const steps = text("steps", { step: game.step, limit });
    const { orders } = game.state ?? {};
    const points = orders ? `${text("points", { points: orders.score })} · ` : "";
    const seconds = game.outcome ? 0 : (limit - game.step) * (game.stepSeconds ?? 0);
    setText(byId("progress"), points + (seconds ? text("timeLeft", { time: clock(Math.ceil(seconds)) }) : steps));
    byId("progress").title = steps;
  }

  roster() {
    const { game, known } = this;
    for (const seat of game.seats) {
      const old = known.get(seat.player);
      const news = old && seat.player !== game.me ? change(old, seat) : "";
      if (news) this.happened(news);
      known.set(seat.player, seat);
    }
    if (game.phase !== this.phase) {
      this.phase = game.phase;
      if (game.phase === "waiting") tellParent("ready", { episode: game.episode, seat: game.me });
      if (game.phase === "running") tellParent("started", { episode: game.episode });
    }
    byId("actions").hidden = game.me === null || game.outcome !== null;
    showSeats(game);
    if (this.kitchen) {
      this.kitchen.seats = game.seats;
      this.kitchen.waitsFor = new Set(game.waitsFor);
    }
    this.hands?.roster();
    this.status();
  }

  status() {
    const { game } = this;
    setText(byId("status"), this.statusWords());
    setText(byId("title"), game.task ? taskTitle(game.task.name) : this.visit.code);
    this.cover.update();
  }

  statusWords() {
    const { game } = this;
    if (game.outcome) return outcomeWords(game.outcome, game.stepSeconds);
    if (!this.connection?.online) return text(game.state ? "offline" : "connecting");
    if (game.phase === "paused") return text("paused");
    if (game.phase === "waiting") return waiting(game);
    if (game.me === null) return text("watching");
    if (game.turn === game.me) return text("yourTurn");
    const turn = game.seats.find((seat) => seat.player === game.turn);
    return turn ? text("theirTurn", { name: turn.name || turn.player }) : "";
  }

  /** @param {import("./game.js").Answer} answer */
  answered(answer) {
    this.hands?.answered(answer);
    if (answer.applied || !answer.reasons.length || !this.game.me) return;
    const { state } = this.game;
    const [why] = answer.why;
    const reason = why && state && this.hands
      ? this.hands.wording.reason({ ...why, words: answer.reasons[0] }, state) : answer.reasons[0];
    this.bubbles?.show(this.game.me, { words: reason, rejected: true });
    this.speak(text("rejected", { reason }));
  }

  /** @param {import("./game.js").Line} line @param {boolean} old */
  heard(line, old) {
    if (line.text.startsWith(INTENDS)) {
      // Bots announce every few steps what they do next, which would drown the chat.
      const [first] = line.text.slice(INTENDS.length).split(";");
      if (!old && line.seat) this.bubbles?.show(line.seat, { words: `${first} …` });
      return;
    }
    this.chat.say(line.name, line.text);
    if (!old && line.seat) {
      this.bubbles?.show(line.seat, { words: line.text, target: line.intent && line.target });
    }
    if (line.seat !== this.game.me) this.speak(text("saidBy", { name: line.name, text: line.text }));
  }

  /** @param {string} news */
  happened(news) {
    this.chat.happened(news);
    this.speak(news);
  }

  /** @param {string} words */
  announce(words) {
    this.chat.happened(words);
    this.notify(words);
  }

  ended() {
    byId("actions").hidden = true;
    this.show();
    this.progress();
    this.hands?.stepped();
    this.status();
    const { outcome, episode, me, stepSeconds } = this.game;
    this.speak(outcomeWords(outcome, stepSeconds));
    tellParent("ended", { episode, seat: me, outcome });
  }

  /** Say something to a screen reader. @param {string} words */
  speak(words) {
    // A new text replaces the last one at least once a second, so that a busy chat does not make the
    // text longer and longer.
    if (now() - this.spokenAt < SPOKEN_SECONDS && byId("live").textContent) {
      byId("live").append(` ${words}`);
    } else {
      setText(byId("live"), words);
      this.spokenAt = now();
    }
  }

  /** Show a short text for a moment. @param {string} words */
  notify(words) {
    if (!words) return;
    setText(byId("notice"), words);
    this.noticeUntil = now() + NOTICE_SECONDS + READING_SECONDS * words.length;
  }

  draw() {
    const at = now();
    this.hands?.tick();
    if (this.kitchen && this.bubbles) {
      this.kitchen.rejected = this.bubbles.rejected;
      this.kitchen.pointing = this.bubbles.pointing;
      this.kitchen.draw(at);
    }
    this.bubbles?.place(at);
  }

  tick() {
    if (this.noticeUntil && now() > this.noticeUntil) {
      this.noticeUntil = 0;
      setText(byId("notice"), "");
    }
    if (this.connection?.online) this.game.repeat();
    const { running, stepSeconds, pause } = this.game;
    if (running && stepSeconds !== null && !pause) this.connection?.expectNews(5 * stepSeconds);
    this.cover.update();
  }

  // What the reader does

  /** @param {Event} event */
  say(event) {
    event.preventDefault();
    const input = /** @type {HTMLInputElement} */ (byId("said"));
    const said = input.value.trim();
    if (!said) return;
    if (this.game.say(said)) input.value = "";
    else this.notify(text("offline"));
    byId("kitchen").focus();
  }

  share() {
    const link = new URL(`play#${this.game.code}`, location.href).href;
    const copied = navigator.clipboard?.writeText(link);
    if (copied) copied.then(() => this.notify(text("copied")), () => this.notify(link));
    else this.notify(link);
  }

  async rematch() {
    const { game } = this;
    if (!game.rematch && !this.connection?.online) {
      this.notify(text("offline"));
      return;
    }
    const answer = game.rematch
      ? { type: "created", code: game.rematch }
      : await this.ask({ type: "create", rematch: game.episode });
    if (answer.type !== "created") {
      this.notify(String(answer.message));
      return;
    }
    this.close();
    this.exits.moved(String(answer.code));
  }

  /** Leave; ask the player of a running game first, unless the parent page has decided it. */
  leave(decided = false) {
    const playing = this.game.running && this.game.me !== null;
    if (playing && !decided && !confirm(text("leaveSure"))) return;
    this.connection?.send({ type: "leave" });
    tellParent("left", { reason: "" });
    keepSeat(this.key, null);
    this.close();
    this.exits.left("");
  }

  /** @param {"connecting" | "online" | "offline" | "closed"} status */
  connected(status) {
    this.cover.offline = status !== "online" && status !== "closed" && this.game.state !== null;
    if (status === "online") this.askAgain();
    this.status();
  }

  /** Show why this visit has ended. @param {string} code @param {string} reason */
  farewell(code, reason) {
    // The end card stays: nothing can change any more.
    if (this.game.outcome) return;
    // Another tab may have a newer token by now.
    const own = seatToken(this.key) === this.connection?.identity.resume;
    if (own && (SEATLESS.has(code) || code.startsWith("auth/"))) keepSeat(this.key, null);
    this.close();
    if (!this.game.state) clearPanel();
    tellParent("left", { reason: code });
    const [title, detail, retry] = FAREWELLS.get(code) ?? ["sorry", "", "again"];
    const words = detail ? text(detail) : reason;
    const cover = byId("cover");
    cover.hidden = false;
    cover.className = "";
    const choices = element("p", { class: "buttons" });
    if (retry === "watch") choices.append(button(text("watch"), () => this.exits.watch(), true));
    else if (retry) {
      choices.append(button(text(retry), () => location.reload(), true));
    }
    cover.replaceChildren(slip(text(title), element("p", {}, words), choices));
    setText(byId("status"), text(title));
  }

  close() {
    this.over = true;
    clearInterval(this.timer);
    this.connection?.close();
    this.abort.abort();
    this.hands?.close();
    this.bubbles?.showOnly(new Map());
    this.kitchen?.close();
    byId("cover").hidden = true;
    setText(byId("notice"), "");
  }
}

/** Remove what an earlier game has left in the panel. */
function clearPanel() {
  for (const part of ["ticket", "seats", "lines", "choices", "hint"]) byId(part).replaceChildren();
}

/** Codes after which the seat is lost for good. */
const SEATLESS = new Set([
  "episode/unknown", "episode/ended", "episode/banned", "episode/left", "episode/full", "seat/taken",
  "seat/partial",
]);

/** @type {Map<string, [string, string, string]>} Title, detail and button by the server's code. */
const FAREWELLS = new Map([
  ["session/elsewhere", ["elsewhere", "elsewhereDetail", "playHere"]],
  ["episode/unknown", ["unknown", "unknownDetail", "again"]],
  ["episode/ended", ["ended", "", ""]],
  ["episode/full", ["full", "fullDetail", "watch"]],
  ["seat/taken", ["taken", "takenDetail", "watch"]],
  ["seat/partial", ["partial", "partialDetail", ""]],
  ["episode/banned", ["banned", "", ""]],
  ["server/stopped", ["stopped", "", "again"]],
  ["page/files", ["files", "filesDetail", "again"]],
  ["protocol/version", ["version", "versionDetail", "again"]],
  .../** @type {[string, [string, string, string]][]} */ (["required", "invalid", "expired", "revoked"]
    .map((code) => [`auth/${code}`, ["token", "tokenDetail", ""]])),
]);

/** Return the news between two rosters of a seat. */
function change(
  /** @type {import("./game.js").Seat} */ old,
  /** @type {import("./game.js").Seat} */ seat,
) {
  if (old.name !== seat.name) {
    return seat.name ? text("joined", { name: seat.name }) : text("gone", { name: old.name });
  }
  if (!seat.name || old.present === seat.present) return "";
  return text(seat.present ? "back" : "away", { name: seat.name });
}
