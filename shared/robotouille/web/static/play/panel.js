// Who cooks, and the chat.

import { SEATS } from "../kitchen/pictures.js";
import { byId, element } from "./dom.js";
import { text } from "./texts.js";

/** @typedef {import("./game.js").Game} Game */
/** @typedef {import("./game.js").Seat} Seat */
const MAX_LINES = 200;

/** Return a seat's mark: a shape of its own in its colour. @param {number} index */
export function seatMark(index) {
  const shapes = [
    "M11 2a9 9 0 1 0 .01 0z", "M3 3h16v16H3z", "M11 2l9 17H2z", "M11 1l10 10-10 10L1 11z",
    "M6 2h10l5 9-5 9H6L1 11z", "M11 1l3 7 7 .500-5.500 4.500 2 7-6.500-4-6.500 4 2-7L1 8.500 8 8z",
  ];
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 22 22");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", shapes[index % shapes.length]);
  path.setAttribute("fill", SEATS[index % SEATS.length]);
  path.setAttribute("stroke", "#3b2f2f");
  svg.append(path);
  return svg;
}

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
  }

  /** @param {string} name @param {string} said */
  say(name, said) {
    this.add(element("li", {}, element("b", {}, `${name}: `), said));
  }

  /** @param {string} what */
  happened(what) {
    this.add(element("li", { class: "happened" }, what));
  }

  /** @param {HTMLElement} line */
  add(line) {
    const { lines } = this;
    const below = lines.scrollTop + lines.clientHeight >= lines.scrollHeight - 8;
    lines.append(line);
    while (lines.childElementCount > MAX_LINES) lines.firstElementChild?.remove();
    if (below) lines.scrollTop = lines.scrollHeight;
  }
}
