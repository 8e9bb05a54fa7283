// What covers the kitchen: the waiting room, pauses, a lost connection, the end.

import { won } from "../kitchen/painter.js";
import { capitalised } from "../rules/words.js";
import { socketAddress } from "./connection.js";
import { byId, element, now, setText } from "./dom.js";
import { seatMark, seatWords } from "./panel.js";
import { clock, duration, listed, text } from "./texts.js";

/** @typedef {import("./game.js").Game} Game */
/**
 * @typedef {{ready: (ready: boolean) => void, rematch: () => void, share: () => void,
 *   mayRepeat: boolean, next: URL | null}} Answers `next` is the address to which the game's end
 *   leads. `mayRepeat` is true if the next game can be entered.
 */

const STARS = 3;
/** Seconds for which a waiting room stays open without players (episode/presence.py). */
const LOBBY_SECONDS = 600;
/** Names of this machine, where a person can start a bot. */
const LOCAL = new Set(["localhost", "127.0.0.1", "[::1]"]);

/** Chooses and draws the cover. It is built again only when its content changes. */
export class Cover {
  /** @param {Game} game @param {Answers} answers */
  constructor(game, answers) {
    this.game = game;
    this.answers = answers;
    this.root = byId("cover");
    this.shown = this.kindShown = "";
    this.offline = false;
    /** @type {string[][]} Kinds of stations with what they are for, once the kitchen is loaded. */
    this.purposes = [];
    /** @type {HTMLElement | null} */
    this.ticking = null;
  }

  update() {
    const { game } = this;
    const kind = this.kind();
    const shown = JSON.stringify([kind, kind === "lobby" && [game.seats, this.purposes], game.rematch, game.pause?.reason, game.stars,
      game.seats.map((seat) => seat.present)]);
    if (shown !== this.shown) {
      this.shown = shown;
      this.ticking = null;
      this.draw(kind);
    }
    if (this.ticking) setText(this.ticking, this.counted(kind));
  }

  kind() {
    const { game } = this;
    if (!game.state) return "";
    if (game.outcome) return "end";
    if (this.offline) return "offline";
    if (game.phase === "paused" && game.pause) return "pause";
    if (game.phase !== "waiting") return "";
    return game.startsAt === null ? "lobby" : "count";
  }

  /** @param {string} kind */
  draw(kind) {
    const slips = new Map([
      ["lobby", () => this.lobby()],
      ["count", () => this.count()],
      ["pause", () => this.pause()],
      ["offline", () => slip(text("offline"), element("p", {}, text("offlineDetail")))],
      ["end", () => this.end()],
    ]);
    const make = slips.get(kind);
    this.root.hidden = !make;
    this.root.className = kind;
    const focused = this.root.contains(document.activeElement);
    const isNew = kind !== this.kindShown;
    this.kindShown = kind;
    this.root.replaceChildren(...(make ? [make()] : []));
    const button = this.root.querySelector("button.main");
    // The keyboard goes on where it was: in the cover, or in the kitchen behind it.
    const typing = document.activeElement instanceof HTMLInputElement;
    const asks = kind === "end" || kind === "lobby";
    if (button instanceof HTMLElement && asks && (focused || (isNew && !typing))) button.focus();
    else if (focused || document.activeElement === document.body) byId("kitchen").focus();
  }

  lobby() {
    const { game } = this;
    const rows = game.seats.map((seat, index) => {
      const state = !seat.name ? "isFree" : !seat.present ? "isAway" : seat.ready ? "isReady" : "isHere";
      const marks = seatWords({ ...seat, present: true }, game);
      return element(
        "li", {}, seatMark(index), seat.name || seat.player,
        element("span", { class: "faint" }, [marks, text(state)].filter(Boolean).join(", ")),
      );
    });
    this.ticking = element("p", { role: "timer" });
    const made = slip(text("lobby"), this.ticking, element("ul", {}, ...rows));
    const goal = game.task?.problem.goal_description;
    if (goal) made.append(element("p", {}, String(goal)));
    const uses = this.purposes.map(([kind, use]) => element("li", {}, element("b", {}, capitalised(kind)), use));
    if (game.task?.problem.shift) made.append(element("ul", { class: "purposes" }, ...uses));
    const lasts = shiftLength(game);
    if (lasts) made.append(element("p", {}, text("shiftLasts", { time: lasts })));
    const bounds = starBounds(game);
    if (bounds) made.append(element("p", {}, text("starPoints", { one: bounds[0], two: bounds[1], three: bounds[2] })));
    const touch = matchMedia("(pointer: coarse)").matches;
    if (game.me !== null) made.append(element("p", {}, text(touch ? "howTouch" : "howKeys")));
    const ready = game.seat?.ready ?? true;
    const choose = game.me !== null &&
      button(text(ready ? "notReady" : "ready"), () => this.answers.ready(!ready), !ready);
    const free = game.seats.some((seat) => !seat.name);
    const invites = free && game.seats.length > 1;
    const share = invites && button(text("copy"), () => this.answers.share());
    made.append(element("p", { class: "buttons" }, choose, share));
    if (invites) made.append(element("p", { class: "faint" }, text("lobbyCode", { code: game.code })));
    if (free && this.answers.mayRepeat && LOCAL.has(location.hostname)) {
      const command = `robotouille-bot planner --stay --episode ${game.code} --url ${socketAddress(location.href)}`;
      made.append(element("p", { class: "faint" }, text("lobbyBot"), " ", element("code", {}, command)));
    }
    made.append(element("p", { class: "faint" }, timeouts(game)));
    return made;
  }

  count() {
    this.ticking = element("p", { class: "number", role: "timer" });
    return this.ticking;
  }

  pause() {
    const { game } = this;
    const away = game.seats.filter((seat) => seat.name && !seat.present).map((seat) => seat.name);
    const reason = game.pause?.reason ?? "";
    const title = new Map([
      ["absence", text("absence", { names: listed(away) })],
      ["restart", text("restart")],
      ["operator", text("operator")],
      ["storage", text("storage")],
      ["deserted", text("deserted")],
    ]).get(reason) ?? text("paused");
    const detail = element("p");
    if (reason === "storage") detail.textContent = text("storageDetail");
    else if (reason === "restart") detail.textContent = text("waitsDetail", { names: listed(away) });
    else if (game.pause?.left != null) this.ticking = detail;
    return slip(title, detail);
  }

  /** Return the text of a countdown. @param {string} kind */
  counted(kind) {
    const { game } = this;
    if (kind === "lobby") {
      return `${waiting(game)} · ${text("waited", { time: clock(now() - game.waitingSince) })}`;
    }
    if (kind === "count") {
      const left = Math.ceil((game.startsAt ?? 0) - now());
      return left > 0 ? String(left) : text("go");
    }
    const left = Math.max(0, (game.pause?.left ?? 0) - (now() - game.pausedAt));
    const key = game.pause?.reason === "absence" ? "absenceDetail" : "endsDetail";
    return text(key, { seconds: Math.ceil(left) });
  }

  end() {
    const { game } = this;
    const rating = ratingOf(game);
    const idle = onlyWatched(game);
    const title = won(game.outcome) && idle ? "othersWon"
      : rating?.stars === 0 ? "shiftEnded" : won(game.outcome) ? "won" : "lost";
    const made = slip(text(title), element("p", {}, `${outcomeWords(game.outcome, game.stepSeconds)}.`));
    if (rating) {
      const { stars, next: take } = rating;
      const row = element("p", { class: "stars", role: "img", "aria-label": `${stars} / ${STARS}` });
      for (let each = 0; each < STARS; each += 1) {
        row.append(element("span", { class: each < stars ? "" : "off" }, "★"));
      }
      made.append(row, element("p", {}, text(idle ? "idle" : `stars${Math.min(stars + 1, STARS)}`, { take })));
    }
    const { next, mayRepeat } = this.answers;
    const buttons = element("p", { class: "buttons" });
    if (next) {
      const words = text("next", { site: next.host });
      buttons.append(button(words, () => location.assign(next), true));
    } else if (mayRepeat && (game.me !== null || game.rematch)) {
      const withBot = game.seats.some(({ kind }) => kind === "bot");
      if (withBot && !game.rematch) made.append(element("p", {}, text("botsLeave")));
      const words = text(game.rematch ? "joinRematch" : "rematch");
      buttons.append(button(words, () => this.answers.rematch(), true));
    } else if (!mayRepeat) {
      made.append(element("p", {}, text("mayClose")));
    }
    made.append(buttons);
    return made;
  }
}

/** Return a card with a title. @param {string} title @param {...(Node | false)} content */
export function slip(title, ...content) {
  return element("div", { class: "slip" }, element("h2", {}, title), ...content);
}

/** @param {string} words @param {() => void} does */
export function button(words, does, main = false) {
  return element("button", { type: "button", class: main ? "main" : "", onclick: does }, words);
}

/** Return what a game that has not started waits for. @param {Game} game */
export function waiting(game) {
  if (game.startsAt !== null) return text("starting", { seconds: Math.max(0, Math.ceil(game.startsAt - now())) });
  const late = game.seats.filter((seat) => seat.player !== game.me && seat.name && !(seat.present && seat.ready));
  const free = game.seats.filter((seat) => !seat.name).length;
  const more = free === 0 ? [] : [free === 1 ? text("oneMore") : text("more", { count: free })];
  const whom = [...late.map((seat) => seat.name), ...more];
  if (!whom.length && game.seat && !game.seat.ready) return text("waitingReady");
  return text("waiting", { whom: whom.length ? listed(whom) : text("others") });
}

/** Return for how long the server keeps a game that has not started, and its seats. @param {Game} game */
function timeouts({ me, clock: { grace = 0 } }) {
  const minutes = Math.round(Math.max(grace, LOBBY_SECONDS) / 60);
  const kitchen = text("staysOpen", { minutes });
  return me === null ? kitchen : `${kitchen} ${text("keepsSeat", { seconds: grace })}`;
}

/**
 * Return an outcome in words.
 * @param {Record<string, any> | null} outcome @param {number | null} stepSeconds
 */
export function outcomeWords(outcome, stepSeconds = null) {
  const key = new Map([
    ["goal", "goalReached"], ["shift_over", "shiftOver"], ["step_limit", "stepLimit"],
    ["abandoned", "abandoned"], ["aborted", "aborted"],
  ]).get(outcome?.reason);
  const { points = 0, served = 0, expired = 0 } = outcome?.score ?? {};
  const words = text(key ?? "ended", { time: duration(outcome?.steps ?? 0, stepSeconds), points, served });
  if (key === "shiftOver") return expired ? `${words}, ${text("expired", { expired })}` : words;
  return outcome?.detail ? `${words}: ${outcome.detail}` : words;
}

/** Return whether the player at this page did nothing. @param {Game} game */
function onlyWatched({ me, outcome }) {
  const own = outcome?.seats?.find((/** @type {{player: string}} */ seat) => seat.player === me);
  return own !== undefined && !own.acted;
}

/**
 * Return the length of a shift, as a clock or in steps; empty for other games.
 * @param {Game} game
 */
function shiftLength({ task, clock: { max_steps: limit = Infinity }, stepSeconds }) {
  if (!task?.problem.shift) return "";
  const steps = Math.min(task.problem.shift.steps * task.profile.delayFactor, limit);
  return stepSeconds ? clock(steps * stepSeconds) : text("someSteps", { steps });
}

/**
 * Return the points of one, two and three stars of a shift; null if the task has none.
 * @param {Game} game
 * @returns {number[] | null}
 */
function starBounds({ task }) {
  const bounds = task?.problem.shift?.stars?.[task.players.length];
  return Array.isArray(bounds) ? bounds : null;
}

/**
 * Return the stars of a game that is over, and what the next star needs; null if its task has none.
 * @param {Game} game
 */
function ratingOf(game) {
  const { reason, steps = 0, score } = game.outcome ?? {};
  const bounds = reason === "shift_over" && score ? starBounds(game) : null;
  if (!bounds && !(game.stars && reason === "goal")) return null;
  const [three, two] = game.stars ?? [0, 0];
  const earned = bounds ? bounds.filter((bound) => score.points >= bound).length
    : steps <= three ? 3 : steps <= two ? 2 : 1;
  const next = bounds ? text("points", { points: bounds[Math.min(earned, STARS - 1)] })
    : text("atMost", { time: duration(earned === 1 ? two : three, game.stepSeconds) });
  return { stars: onlyWatched(game) ? 0 : earned, next };
}
