// The panel beside the kitchen: what is wanted, who cooks, and the chat.

import { dishes, orderPictures } from "../kitchen/dishes.js";
import { pictureURL, SEATS } from "../kitchen/pictures.js";
import { byId, element, setText } from "./dom.js";
import { text } from "./texts.js";

/** @typedef {import("./game.js").Game} Game */
/** @typedef {import("./game.js").Seat} Seat */
/** @typedef {import("../kitchen/look.js").Look} Look */
/** @typedef {(task: any, state: any) => boolean[]} Holding */

// Share of an order's time that is left when it becomes urgent.
const URGENT = 0.3;
const MAX_LINES = 200;

/** What the players are to make. */
export class Ticket {
  /** @param {Game} game @param {Look} look @param {Holding} holding */
  constructor(game, look, holding) {
    this.game = game;
    this.look = look;
    this.holding = holding;
    this.root = byId("ticket");
    /** @type {Map<number, {root: HTMLElement, left: HTMLElement, bar: HTMLProgressElement}>} */
    this.slips = new Map();
    this.root.replaceChildren();
    if (game.task?.problem.shift) this.drawOrders();
    else this.drawGoal();
  }

  /** Show a new state. */
  update() {
    if (this.game.task?.problem.shift) this.updateOrders();
    else this.updateGoal();
  }

  drawGoal() {
    const { task, state } = this.game;
    if (!task || !state) return;
    this.root.append(element("h2", {}, text("goal")));
    const found = dishes(task, this.look);
    /** @type {{row: HTMLElement, terms: number[]}[]} */
    this.rows = [];
    if (!found) {
      this.root.append(element("p", { class: "dish" }, String(task.problem.goal_description)));
      return;
    }
    for (const dish of found) {
      const list = element("ul", { class: "dish" });
      for (const layer of dish.layers) {
        const src = pictureURL(this.look, layer.appearance);
        const row = element("li", {}, element("img", { src, alt: "" }), layer.words);
        row.title = layer.conditions.join("\n");
        list.append(row);
        this.rows.push({ row, terms: [...layer.terms, ...layer.below] });
      }
      this.root.append(list);
    }
    this.updateGoal();
  }

  updateGoal() {
    const { task, state } = this.game;
    if (!task || !state || !this.rows) return;
    const holding = this.holding(task, state);
    for (const { row, terms } of this.rows) {
      row.classList.toggle("done", terms.every((number) => holding[number]));
    }
  }

  drawOrders() {
    this.root.append(element("h2", {}, text("orders")));
    this.none = element("p", { class: "faint" }, text("noOrders"));
    this.root.append(this.none);
    this.updateOrders();
  }

  updateOrders() {
    const { task, state } = this.game;
    const orders = state?.orders;
    if (!task || !orders || !this.none) return;
    const open = new Set(orders.open.map((each) => each.number));
    for (const [number, slip] of this.slips) {
      if (open.has(number)) continue;
      slip.root.remove();
      this.slips.delete(number);
    }
    for (const { number, due } of orders.open) this.showOrder(number, due - orders.time);
    this.none.hidden = open.size > 0;
  }

  /** @param {number} number @param {number} left Steps until the order expires. */
  showOrder(number, left) {
    const { shift } = this.game.task?.problem ?? {};
    const name = shift?.arrivals?.[number]?.dish;
    let slip = this.slips.get(number);
    if (!slip) {
      const pictures = element("div", { class: "pictures" });
      for (const appearance of this.game.task ? orderPictures(this.game.task, this.look, name) : []) {
        pictures.append(element("img", { src: pictureURL(this.look, appearance), alt: "" }));
      }
      const bar = element("progress", { max: left, "aria-label": name });
      const remaining = element("span", { class: "left" });
      const root = element("div", { class: "order" }, element("b", {}, name), pictures, bar, remaining);
      slip = { root, left: remaining, bar };
      this.slips.set(number, slip);
      this.root.append(root);
    }
    slip.bar.value = left;
    const seconds = this.game.stepSeconds;
    setText(slip.left, seconds === null
      ? text("leftSteps", { steps: left })
      : text("left", { seconds: Math.ceil(left * seconds) }));
    slip.root.classList.toggle("urgent", left < URGENT * slip.bar.max);
  }
}

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
