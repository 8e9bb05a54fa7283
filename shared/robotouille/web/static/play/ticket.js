// The ticket beside the kitchen: the goal's dishes with ticks, or the open orders of a shift.

import { dishes, orderLayers } from "../kitchen/dishes.js";
import { pictureURL } from "../kitchen/pictures.js";
import { Goal } from "../rules/goal.js";
import { capitalised } from "../rules/words.js";
import { byId, element, setText } from "./dom.js";
import { duration, text } from "./texts.js";

/** @typedef {Pick<import("./game.js").Game, "task" | "state" | "step" | "stepSeconds">} Game */
/** @typedef {import("../kitchen/look.js").Look} Look */
/** @typedef {import("../kitchen/dishes.js").Dish} Dish */
/** @typedef {import("../rules/state.js").State} State */
/** @typedef {import("../rules/goal.js").Order} Order */

// Share of an order's time that is left when it becomes urgent.
const URGENT = 0.3;
// Largest number of dishes that are tried in every order.
const MAX_ORDERED = 4;

/**
 * Return the ticket of a game: `update` shows a new state.
 * @param {Game} game @param {Look} look @param {HTMLElement} [root]
 */
export function newTicket(game, look, root = byId("ticket")) {
  const shift = Boolean(game.task?.problem.shift);
  root.replaceChildren(element("h2", {}, text(shift ? "orders" : "goal")));
  const ticket = shift ? new Orders(game, look, root) : new Dishes(game, look, root);
  ticket.update();
  return ticket;
}

/** The goal's dishes. */
class Dishes {
  /** @param {Game} game @param {Look} look @param {HTMLElement} root */
  constructor(game, look, root) {
    this.game = game;
    const task = /** @type {import("../rules/task.js").Task} */ (game.task);
    this.goal = new Goal(task);
    this.dishes = dishes(task, look) ?? [];
    /** @type {HTMLElement[][]} */
    this.rows = this.dishes.map(({ layers }) => {
      const rows = layers.map((layer) => {
        const src = pictureURL(look, layer.appearance);
        const row = element("li", {}, element("img", { src, alt: "" }), layer.words);
        row.title = layer.conditions.join("\n");
        return row;
      });
      root.append(element("ul", { class: "dish" }, ...rows));
      return rows;
    });
    if (!this.dishes.length) {
      root.append(element("p", { class: "dish" }, String(task.problem.goal_description ?? "")));
    }
    // A plate that stands on a table anyway is not ticked off before the first step.
    this.atFirst = game.step === 0 && game.state ? this.holding(game.state) : [];
  }

  update() {
    const { state } = this.game;
    if (!state || !this.dishes.length) return;
    const holding = this.holding(state);
    this.dishes.forEach((dish, number) => {
      const settled = settledLayers(dish, holding, this.atFirst);
      settled.forEach((done, layer) => {
        const row = this.rows[number][layer];
        row.classList.toggle("done", done);
        row.setAttribute("aria-current", String(done));
      });
    });
  }

  /** Return which terms of the goal hold. @param {State} state */
  holding(state) {
    /** @type {boolean[]} */
    let best = [];
    for (const order of dishOrders(this.dishes)) {
      const { holding } = this.goal.fit(state, fitOrder(order));
      if (count(holding) > count(best) || !best.length) best = holding;
    }
    return best;
  }
}

const count = (/** @type {boolean[]} */ held) => held.filter(Boolean).length;

/**
 * Return which layers of a dish are as the goal wants them, with everything below.
 * @param {Dish} dish @param {boolean[]} holding @param {boolean[]} atFirst
 */
function settledLayers(dish, holding, atFirst) {
  const held = (/** @type {any} */ layer, /** @type {boolean[]} */ terms) => {
    const based = layer.base.every((/** @type {number} */ n) => terms[n]);
    return layer.terms.map((/** @type {number} */ n) =>
      Boolean(terms[n]) && (based || !layer.places.includes(n)));
  };
  const now = dish.layers.map((layer) => held(layer, holding));
  const first = dish.layers.map((layer) => held(layer, atFirst));
  const right = dish.layers.map((layer, i) =>
    layer.terms.length > 0 && now[i].every(Boolean) && layer.below.every((n) => holding[n]));
  const begun = right.some((fine, i) => fine && !first[i].every(Boolean));
  const whole = now.every((each) => each.every(Boolean));
  return dish.layers.map((_, i) => whole || (right[i] && (!first[i].every(Boolean) || begun)));
}

/**
 * Yield orders of dishes, the problem's first, so that it wins if several fit equally.
 * @param {Dish[]} all
 * @returns {Generator<Dish[]>}
 */
function* dishOrders(all) {
  const first = (/** @type {Dish} */ { layers }) => Math.min(Infinity, ...layers.flatMap(({ terms }) => terms));
  const ordered = [...all].sort((a, b) => first(a) - first(b));
  if (ordered.length <= MAX_ORDERED) yield* permutations(ordered);
  else for (let n = 0; n < ordered.length; n += 1) yield [...ordered.slice(n), ...ordered.slice(0, n)];
}

/**
 * @template T
 * @param {T[]} items
 * @returns {Generator<T[]>}
 */
function* permutations(items) {
  if (items.length < 2) yield items;
  else {
    for (let i = 0; i < items.length; i += 1) {
      const rest = [...items.slice(0, i), ...items.slice(i + 1)];
      for (const order of permutations(rest)) yield [items[i], ...order];
    }
  }
}

/**
 * Return the order in which terms are tried: places with their base, then facts.
 * @param {Dish[]} all
 * @returns {Order}
 */
function fitOrder(all) {
  /** @type {[number, number, number, number[]][]} */
  const places = [];
  /** @type {[number, number][]} */
  const facts = [];
  all.forEach(({ layers }, rank) => {
    for (const layer of layers) {
      for (const n of layer.places) places.push([layer.base.length ? 1 : 0, rank, n, layer.base]);
      for (const n of layer.terms) if (!layer.places.includes(n)) facts.push([rank, n]);
    }
  });
  places.sort((a, b) => a[0] - b[0] || a[1] - b[1] || a[2] - b[2]);
  facts.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  return [
    ...places.map(([, , n, base]) => /** @type {[number, number[]]} */ ([n, base])),
    ...facts.map(([, n]) => /** @type {[number, number[]]} */ ([n, []])),
  ];
}

/** The open orders. */
class Orders {
  /** @param {Game} game @param {Look} look @param {HTMLElement} root */
  constructor(game, look, root) {
    this.game = game;
    this.look = look;
    this.root = root;
    this.none = element("p", { class: "faint" }, text("noOrders"));
    root.append(this.none);
    /** @type {Map<number, ReturnType<Orders["newSlip"]>>} */
    this.slips = new Map();
  }

  update() {
    const orders = this.game.state?.orders;
    if (!orders) return;
    const open = new Set(orders.open.map(({ number }) => number));
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
    const slip = this.slips.get(number) ?? this.newSlip(number, left);
    slip.bar.value = left;
    setText(slip.worth, `+${slip.points + Math.floor((slip.tip * Math.max(0, left)) / slip.bar.max)}`);
    setText(slip.left, text("timeLeft", { time: duration(left, this.game.stepSeconds) }));
    slip.root.classList.toggle("urgent", left < URGENT * slip.bar.max);
  }

  /** @param {number} number @param {number} left */
  newSlip(number, left) {
    const { game, look } = this;
    const task = /** @type {import("../rules/task.js").Task} */ (game.task);
    const { menu, arrivals } = task.problem.shift;
    const name = String(arrivals[number]?.dish ?? "");
    const dish = Object.hasOwn(menu, name) ? menu[name] : {};
    const layers = orderLayers(task, look, name);
    const images = layers.map(({ appearance }) =>
      element("img", { src: pictureURL(look, appearance), alt: "" }));
    const parts = layers.map(({ words }) => words).reverse().join(", ");
    const max = (dish.patience ?? 0) * task.profile.delayFactor || left;
    const bar = element("progress", { max, "aria-label": name });
    const remaining = element("span", { class: "left" });
    const { points = 0, tip = 0, penalty = 0 } = dish;
    const worth = element("span");
    const head = element("p", {}, element("b", {}, name), " ", worth);
    const title = [text(tip ? "worthEarly" : "worth", { dish: capitalised(name), points, tip })];
    if (penalty) title.push(text("penalty", { points: penalty }));
    const pictures = element("div", { class: "pictures" }, ...images);
    const slip = {
      root: element("div", { class: "order", title: title.join("\n") }, head, pictures, remaining, element("small", {}, parts), bar),
      left: remaining,
      bar, worth, points, tip,
    };
    this.slips.set(number, slip);
    this.root.append(slip.root);
    return slip;
  }
}
