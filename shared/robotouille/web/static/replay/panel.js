// Beside the kitchen: the ticket, the cooks, and the list of events of one recording.

import { element, setText } from "../play/dom.js";
import { seatMark } from "../play/panel.js";
import { clock, text } from "../play/texts.js";
import { newTicket } from "../play/ticket.js";

/** @typedef {import("./words.js").Words} Words */

// Events shown before and after the current step.
const [BEFORE, AFTER] = [50, 10];
// Milliseconds of a frame for lines that are new.
const BUDGET_MS = 8;

export class Panel {
  /** @param {Words} words @param {any} look @param {(step: number, ms: number) => void} go */
  constructor(words, look, go) {
    const { reel } = words;
    this.reel = reel;
    this.words = words;
    this.go = go;
    this.ticketRoot = element("section", { class: "ticket" });
    const stepSeconds = reel.raw.clock === "realtime" ? 1 / reel.raw.rate : null;
    this.game = { task: reel.task, state: reel.state(0), step: 0, stepSeconds };
    this.ticket = newTicket(this.game, look, this.ticketRoot);
    this.points = element("p", { class: "points", hidden: true });
    this.ticketRoot.append(this.points);
    this.rows = reel.task.players.map((_, seat) => {
      const [who, kind, does] = ["who", "kind faint", "does faint"].map((name) =>
        element("span", { class: name }));
      const row = element("li", {}, seatMark(seat), element("div", {}, who, " ", kind, does));
      return { row, who, kind, does };
    });
    this.cooks = element("section", { class: "cooks" },
      element("h2", {}, text("seats")), element("ul", {}, ...this.rows.map(({ row }) => row)));
    this.lines = element("ol", { class: "lines" });
    this.events = element("section", { class: "events" },
      element("h2", {}, text("log")), this.lines);
    /** @type {Map<number, HTMLElement>} */
    this.known = new Map();
    this.shown = "";
  }

  /** Show a step. @param {number} step */
  update(step) {
    const { reel, words, game } = this;
    game.state = reel.state(step);
    game.step = step;
    this.ticket.update();
    const { orders } = game.state;
    this.points.hidden = !orders;
    if (orders) setText(this.points, text("points", { points: orders.score }));
    const cooks = reel.cooks(step);
    this.rows.forEach(({ who, kind, does }, seat) => {
      const cook = cooks[seat];
      setText(who, cook.name || text("isFree"));
      const known = cook.kind === "bot" || cook.kind === "model";
      setText(kind, known ? text(cook.kind) : "");
      setText(does, step ? words.doing(seat, step) : "");
    });
    this.showLines(step);
  }

  /** @param {number} step */
  showLines(step) {
    const { reel, lines } = this;
    const until = reel.eventsUntil(step);
    const [first, end] = [Math.max(0, until - BEFORE), Math.min(reel.log.length, until + AFTER)];
    const shown = `${first} ${until} ${end}`;
    if (shown === this.shown) return;
    for (const place of this.known.keys()) {
      if (place < first || place >= end) this.known.delete(place);
    }
    // The newest events come first. Words of an action take a millisecond, so that the others may
    // have to wait for the next frames.
    const late = performance.now() + BUDGET_MS;
    let from = until;
    while (from > first && performance.now() < late) this.line((from -= 1), false);
    let to = until;
    while (to < end && performance.now() < late) this.line((to += 1) - 1, true);
    this.shown = from === first && to === end ? shown : "";
    const rows = [];
    for (let place = from; place < to; place += 1) {
      rows.push(/** @type {HTMLElement} */ (this.known.get(place)));
    }
    lines.replaceChildren(...rows);
    // The newest event that has happened is at the bottom, above those to come.
    const newest = rows[until - from - 1];
    lines.scrollTop = newest
      ? newest.offsetTop + newest.offsetHeight - lines.clientHeight : 0;
  }

  /** Make the line of an event, if it is not known. @param {number} place @param {boolean} later */
  line(place, later) {
    const known = this.known.get(place);
    if (known) {
      known.classList.toggle("later", later);
      return;
    }
    const entry = this.reel.log[place];
    const { who, what } = this.words.entry(entry);
    const line = element(
      "button", { type: "button", class: `line ${entry.kind}`,
        onclick: () => this.go(entry.step, entry.ms) },
      element("span", { class: "when" }, clock(entry.ms / 1000)),
      element("span", {}, who && element("b", {}, `${who}: `), what),
    );
    this.known.set(place, element("li", { class: later ? "later" : "" }, line));
  }
}
