// Who cooks, and the chat.

import { badgeURL } from "../kitchen/pictures.js";
import { byId, element } from "./dom.js";
import { text } from "./texts.js";

/** @typedef {import("./game.js").Game} Game */
/** @typedef {import("./game.js").Seat} Seat */
const MAX_LINES = 200;
/** Newest lines among which equal ones are shown once. */
const GROUPED = 6;

/** Return a seat's mark, as in the kitchen: a shape of its own in its colour. @param {number} seat */
export const seatMark = (seat) => element("img", { class: "mark", src: badgeURL(seat), alt: "" });

/** Return what a seat's participant is and does, for the list. @param {Seat} seat @param {Game} game */
export function seatWords(seat, game) {
  const marks = [];
  if (seat.player === game.me) marks.push(text("you"));
  if (seat.kind === "bot" || seat.kind === "model") marks.push(text(seat.kind));
  if (seat.controller === "substitute") marks.push(text("substitute"));
  else if (seat.name && !seat.present) marks.push(text("isAway"));
  return marks.join(", ");
}

/** Show who cooks. @param {Game} game */
export function showSeats(game) {
  const rows = game.seats.map((seat, index) => {
    const marks = seatWords(seat, game);
    return element(
      "li", {}, seatMark(index),
      element("span", { class: "who" }, seat.name || text("isFree")),
      marks && element("span", { class: "faint" }, marks),
    );
  });
  byId("seats").replaceChildren(element("h2", {}, text("seats")), element("ul", {}, ...rows));
}

/** The chat. */
export class Chat {
  constructor() {
    this.lines = byId("lines");
    this.lines.replaceChildren();
    // New orders take height from the chat, and would hide its last lines.
    new ResizeObserver(() => this.showEnd()).observe(this.lines);
  }

  /** Show a line. It replaces an equal one among the newest. @param {string} name @param {string} said */
  say(name, said) {
    const words = `${name}: ${said}`;
    const newest = /** @type {HTMLElement[]} */ ([...this.lines.children].slice(-GROUPED));
    const before = newest.find((line) => line.dataset.said === words);
    before?.remove();
    const times = Number(before?.dataset.times ?? 0) + 1;
    const line = element("p", {}, element("b", {}, `${name}: `), said, times > 1 && ` ×${times}`);
    Object.assign(line.dataset, { said: words, times });
    this.add(line);
  }

  /** @param {string} what */
  happened(what) {
    this.add(element("p", { class: "faint" }, what));
  }

  /** @param {HTMLElement} line */
  add(line) {
    const { lines } = this;
    lines.append(line);
    while (lines.childElementCount > MAX_LINES) lines.firstElementChild?.remove();
    this.showEnd();
  }

  /** Scroll to the last line, unless the player reads the chat. */
  showEnd() {
    const { lines } = this;
    // The panel's height changes with the orders, so the position alone does not tell a reader.
    if (!lines.matches(":hover, :focus-within")) lines.scrollTop = lines.scrollHeight;
  }
}
