/**
 * The goal as pictures of dishes, from its terms and the rendering. A port of
 * `window/pictures/dishes.py`. Nothing here draws.
 */

import { insides } from "./look.js";

/** @typedef {import("../rules/task.js").Task} Task */
/** @typedef {import("../rules/scene.js").Placed} Placed */
/** @typedef {import("./look.js").Look} Look */
/** @typedef {import("./look.js").Appearance} Appearance */
/** @typedef {number | string} Variable */
/** @typedef {{predicate: string, args: string[], ids: Variable[]}} Term */

/**
 * One object of a wanted dish.
 * @typedef {object} Layer
 * @property {Appearance} appearance
 * @property {string} words
 * @property {number[]} terms Numbers of the goal's terms about the object.
 * @property {string[]} conditions The same terms in words.
 * @property {number[]} below Numbers of the terms about the objects below it.
 * @property {number[]} places Terms that count only if all terms of `base` hold.
 * @property {number[]} base
 */

/** @typedef {{layers: Layer[]}} Dish Layers from the top down. */

const BOTTOM = 0;
const MIDDLE = 1;
const TOP = 2;

/**
 * Return the goal's dishes in order, or null if the goal cannot be drawn.
 * @param {Task} task @param {Look} look
 * @param {Term[]} terms @returns {Dish[] | null}
 */
export function dishes(task, look, terms = task.goal) {
  look.task = task;
  const goal = new Goal(task, look, terms);
  return goal.drawable() ? goal.dishes() : null;
}

/**
 * Return the looks and words of an ordered dish's objects when it is ready, the lowest first.
 *
 * @param {Task} task
 * @param {Look} look
 * @param {string} name Name of the dish on the menu of the shift.
 * @returns {{appearance: Appearance, words: string}[]}
 */
export function orderLayers(task, look, name) {
  const menu = new Map(Object.entries(task.problem.shift?.menu ?? {}));
  const terms = menu.get(name)?.goal;
  /** @type {Dish[]} */
  const found = (terms && dishes(task, look, terms)) || [];
  const layers = found.flatMap((dish) => dish.layers).reverse();
  return layers.filter(({ appearance }) => appearance.role !== "station");
}

class Goal {
  /** @param {Task} task @param {Look} look @param {Term[]} terms */
  constructor(task, look, terms) {
    this.task = task;
    this.look = look;
    this.terms = terms;
    /** @type {Map<string, any>} */
    this.predicates = new Map();
    for (const each of task.domain.predicate_defs) this.predicates.set(each.name, each);
    /** @type {Map<Variable, string>} */
    this.kinds = new Map();
    /** @type {Map<Variable, string>} */
    this.types = new Map();
    for (const { predicate, args, ids } of terms) {
      ids.forEach((id, i) => {
        this.kinds.set(id, args[i]);
        this.types.set(id, this.predicates.get(predicate)?.param_types[i] ?? "");
      });
    }
    /** @type {Map<Variable, Variable>} */
    this.carriers = this.findCarriers();
  }

  /** Return whether the goal is about objects of known kinds, and none of it about players. */
  drawable() {
    const types = new Set(this.task.domain.object_types);
    return (
      this.terms.length > 0 &&
      this.terms.every(({ ids }) => ids.length === 1 || ids.length === 2) &&
      ![...this.kinds.values()].some((kind) => types.has(kind)) &&
      ![...this.types.values()].some((type) => this.task.playerTypes.has(type))
    );
  }

  /** @returns {Dish[]} */
  dishes() {
    const all = [...this.kinds.keys()];
    this.placed = new Map(all.map((id) => [nameOf(id), this.asPlaced(id)]));
    this.inside = insides(this.placed);
    this.related = new Map(all.map((id) => [nameOf(id), this.factsOf(id)]));
    /** @type {Set<Variable>} */
    const seen = new Set();
    const make = (/** @type {Variable} */ root) =>
      ({ layers: [...this.layers(root, seen)].reverse() });
    const found = all.filter((id) => !this.carriers.has(id)).map(make);
    const rest = all.filter((id) => !seen.has(id)).map(make);
    return [...found, ...rest].filter((dish) => dish.layers.length > 0);
  }

  /** Return what each object lies on or in, by the goal's most specific term about it. */
  findCarriers() {
    /** @type {Map<Variable, [number, Variable]>} */
    const found = new Map();
    for (const { predicate, ids } of this.terms) {
      if (ids.length !== 2) continue;
      let [first, second] = ids;
      const stacked = this.task.when.get(predicate) === "next_in_stack";
      if (!stacked && this.isStation(first)) [first, second] = [second, first];
      // A stack relation says more about a place than a container does, and a station the least.
      const rank = stacked ? 2 : this.isStation(second) ? 0 : 1;
      if (first !== second && rank >= (found.get(first)?.[0] ?? -1)) {
        found.set(first, [rank, second]);
      }
    }
    return new Map([...found].map(([thing, [, carrier]]) => [thing, carrier]));
  }

  /** @param {Variable} id */
  isStation(id) {
    return this.task.stationTypes.has(this.types.get(id) ?? "");
  }

  /** @param {Variable} id */
  kind(id) {
    return this.kinds.get(id) ?? "";
  }

  /**
   * Yield an object and everything it carries, from the bottom up.
   * @param {Variable} root @param {Set<Variable>} seen @returns {Generator<Layer>}
   */
  *layers(root, seen) {
    if (seen.has(root)) return;
    seen.add(root);
    const merged = this.carried(root).filter((id) => this.shownBy(id, root));
    const terms = [root, ...merged].flatMap((id) => this.about(id));
    const carries = [...this.carriers.values()].includes(root);
    const own = /** @type {Placed} */ (this.placed?.get(nameOf(root)));
    if (terms.length > 0 || this.isStation(root) || carries) {
      yield {
        appearance: this.look.appearance(own, this.inside ?? new Map(), this.related ?? new Map()),
        words: [root, ...merged].map((id) => this.words(id)).join(" with "),
        terms,
        conditions: terms.map((number) => this.condition(number)),
        below: this.below(root),
        places: terms.filter((number) => this.terms[number].ids.length === 2),
        base: this.base(root),
      };
    }
    for (const above of this.carried(root)) {
      if (merged.includes(above)) {
        seen.add(above);
        for (const inside of this.carried(above)) yield* this.layers(inside, seen);
      } else yield* this.layers(above, seen);
    }
  }

  /**
   * Return the terms about everything below an object in its stack.
   * @param {Variable} thing
   * @param {number} depth Bounds the search: a custom goal can have objects in a circle.
   * @returns {number[]}
   */
  below(thing, depth = 0) {
    const carrier = this.carriers.get(thing);
    if (carrier === undefined || depth > this.kinds.size) return [];
    const under = this.carried(carrier).filter((id) => this.order(id) < this.order(thing));
    const isStacked = this.about(thing).some((number) => {
      const { predicate, ids } = this.terms[number];
      const same = ids[0] === thing && ids[1] === carrier;
      return same && this.task.when.get(predicate) === "next_in_stack";
    });
    if (isStacked) under.push(carrier);
    return under.flatMap((id) => [...this.about(id), ...this.below(id, depth + 1)]);
  }

  /**
   * Return the terms that place the lowest object of the stack, for the objects above it.
   * @param {Variable} thing
   */
  base(thing) {
    const carrier = this.carriers.get(thing);
    if (carrier === undefined || this.order(thing) === BOTTOM) return [];
    const lowest = this.carried(carrier).filter((id) => this.order(id) === BOTTOM);
    return lowest.flatMap((id) => this.about(id)).filter((n) => this.terms[n].ids.length === 2);
  }

  /** @param {Variable} thing */
  words(thing) {
    const about = this.terms.filter(({ ids }) => ids.includes(thing));
    return this.look.words(this.kind(thing), about.map(({ predicate }) => predicate));
  }

  /** @param {number} number */
  condition(number) {
    const { predicate, args } = this.terms[number];
    const kinds = args.map((kind) => `the ${this.look.words(kind, [])}`);
    const says = this.predicates.get(predicate)?.language_descriptors?.["0"];
    if (!says) return [predicate, ...kinds].join(" ");
    let next = 0;
    return says.replace(/\{(\d*)\}/g, (/** @type {string} */ _, /** @type {string} */ index) => {
      const place = index === "" ? next : Number(index);
      next += 1;
      return kinds[place] ?? "";
    });
  }

  /** Return what lies directly on or in an object, the lowest first. @param {Variable} carrier */
  carried(carrier) {
    const found = [...this.carriers].filter(([, host]) => host === carrier).map(([id]) => id);
    return found.sort((a, b) => this.order(a) - this.order(b));
  }

  /** @param {Variable} thing */
  order(thing) {
    const rules = this.about(thing).map((number) => this.task.when.get(this.terms[number].predicate));
    if (rules.includes("bottom_of_stack")) return BOTTOM;
    return rules.includes("top_of_stack") ? TOP : MIDDLE;
  }

  /** Return the terms about an object itself, not about what it carries. @param {Variable} thing */
  about(thing) {
    /** @type {number[]} */
    const found = [];
    this.terms.forEach(({ ids }, number) => {
      const carries = ids.length === 2 && this.carriers.get(ids[1]) === ids[0];
      if ((ids[0] === thing && !carries) || (carries && ids[1] === thing)) found.push(number);
    });
    return found;
  }

  /**
   * Return whether an object is visible only in the picture of its container.
   * @param {Variable} thing @param {Variable} carrier
   */
  shownBy(thing, carrier) {
    const inside = this.look.entity(this.kind(carrier))?.assets.named.get(this.kind(thing));
    return inside !== undefined && inside.asset === null;
  }

  /** @param {Variable} thing @returns {Placed} */
  asPlaced(thing) {
    const alone = this.terms.filter(({ ids }) => ids.length === 1 && ids[0] === thing);
    const host = this.carriers.get(thing);
    return {
      thing: {
        name: nameOf(thing),
        kind: this.kind(thing),
        type: this.types.get(thing) ?? "",
        tile: null,
        facing: null,
        label: null,
      },
      tile: null,
      host: host === undefined ? null : nameOf(host),
      level: 0,
      facing: null,
      at: null,
      facts: new Set(alone.map(({ predicate }) => predicate)),
      contents: [],
    };
  }

  /** @param {Variable} thing */
  factsOf(thing) {
    const about = this.terms.filter(({ ids }) => ids.includes(thing));
    return about.map(({ predicate, args }) => [predicate, ...args]);
  }
}

/** @param {Variable} variable */
function nameOf(variable) {
  return `goal ${variable}`;
}
