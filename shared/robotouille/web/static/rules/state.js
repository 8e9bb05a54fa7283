/**
 * State of an episode, read from snapshots and deltas (docs/protocol.md). States never change.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Thing} Thing
 * @typedef {import("./task.js").Atom} Atom
 * @typedef {{number: number, due: number}} Order
 * @typedef {{
 *   time: number, open: Order[], arrived: number, score: number, served: number, expired: number,
 * }} Orders
 */
import { effectOf, progressOf } from "./effects.js";
import { append, atomName, byText } from "./task.js";

const EXISTS = "~exists";
const SPECIAL = new Map([[-1, EXISTS], [-2, "~used"]]);

/** Atoms by their position in messages. States share a table until a delta extends it. */
class Table {
  /** @param {Task} task @param {string[]} predicates */
  constructor(task, predicates) {
    this.task = task;
    this.predicates = predicates;
    /** @type {string[]} Names of the objects by their position in messages. */
    this.names = [];
    // Without facts that can change, a server sends no objects at all.
    this.things = new Map(task.things);
    /** Rank of each object in the order of the table. */
    this.rank = new Map([...task.things.keys()].map((name, i) => [name, i]));
    /** @type {Atom[]} */
    this.atoms = [];
    /** @type {Map<string, number>} */
    this.position = new Map();
  }

  /**
   * Append the objects and atoms of a message that the table lacks. A delta lists an object whenever
   * it is created, also if it had existed before.
   * @param {any[]} objects @param {any[]} atoms
   */
  extend(objects, atoms) {
    const known = new Set(this.names);
    for (const [name, kind, type] of objects) {
      const texts = [name, kind].every((each) => typeof each === "string");
      if (!texts || !this.task.types.includes(type)) throw new Error(`invalid object ${name}`);
      if (!known.has(name)) this.names.push(name);
      known.add(name);
      if (this.things.has(name)) continue;
      this.rank.set(name, this.rank.size);
      this.things.set(name, { name, kind, type, tile: null, facing: null, label: null });
    }
    for (const [number, ...places] of atoms) {
      const predicate = SPECIAL.get(number) ?? this.predicates[number];
      const args = places.map((/** @type {number} */ place) => this.names[place]);
      const types = SPECIAL.has(number) ? [args[0]] : this.task.predicates.get(predicate);
      if (types?.length !== args.length || args.includes(undefined)) {
        throw new Error(`invalid atom of ${predicate}`);
      }
      const name = atomName([predicate, ...args]);
      if (this.position.has(name)) continue;
      this.position.set(name, this.atoms.length);
      this.atoms.push([predicate, ...args]);
    }
  }

  /**
   * Return the table with more objects and atoms. Other states keep theirs.
   * @param {any[]} objects @param {any[]} atoms
   */
  extended(objects, atoms) {
    if (!objects.length && !atoms.length) return this;
    const copy = new Table(this.task, this.predicates);
    copy.names = [...this.names];
    copy.things = new Map(this.things);
    copy.rank = new Map(this.rank);
    copy.atoms = [...this.atoms];
    copy.position = new Map(this.position);
    copy.extend(objects, atoms);
    return copy;
  }
}

export class State {
  /**
   * @param {Table} table
   * @param {{ step: number, facts: Uint8Array, timers: Map<string, number[]>, busy: Map<string,
   *   number>, orders: Orders | null, }} values
   */
  constructor(table, { step, facts, timers, busy, orders }) {
    this.task = table.task;
    this.step = step;
    this.table = table;
    this.orders = orders;
    /** Counters of the active effects by label, in order of creation. */
    this.timers = timers;
    this._facts = facts;
    this._busy = busy;
    /** @type {ReturnType<typeof progressOf> | null} */
    this._progress = null;
    /** @type {Map<string, Thing> | null} */
    this._objects = null;
    /** @type {Map<string, Atom[]> | null} */
    this._truths = null;
    /** @type {Atom[] | null} */
    this._atoms = null;
  }

  /** Read a snapshot. @param {Task} task @param {any} message */
  static fromSnapshot(task, message) {
    const table = new Table(task, message.predicates);
    table.extend(message.objects, message.atoms);
    const facts = new Uint8Array(table.atoms.length);
    mark(facts, message.facts, 1);
    const timers = new Map(message.timers);
    for (const [label, counters] of timers) checked(table, label, counters);
    const [busy, open] = [busyOf(message), orders(message)];
    return new State(table, { step: message.step, facts, timers, busy, orders: open });
  }

  /** Return the values, which `advance` may change. */
  values() {
    const { table, step, orders } = this;
    const [facts, timers] = [this._facts.slice(), new Map(this.timers)];
    return { table, step, facts, timers, busy: this._busy, orders };
  }

  /** Return the state after a step. @param {any} delta */
  after(delta) {
    const values = this.values();
    advance(values, delta);
    return new State(values.table, values);
  }

  /**
   * Return the state after a change of facts.
   * @param {{added: Atom[], removed: Atom[]}} changes
   */
  changed({ added, removed }) {
    const values = this.values();
    const places = (/** @type {Atom[]} */ atoms) =>
      atoms.map((atom) => this.table.position.get(atomName(atom)));
    mark(values.facts, places(added), 1);
    mark(values.facts, places(removed), 0);
    return new State(this.table, values);
  }

  /** Objects that exist now, by type, then in the order of their names' numbers. */
  get objects() {
    if (!this._objects) {
      const { types } = this.task;
      const there = [...this.table.things.values()].filter(({ name }) => this.exists(name));
      there.sort((a, b) => types.indexOf(a.type) - types.indexOf(b.type));
      this._objects = new Map(there.map((thing) => [thing.name, thing]));
    }
    return this._objects;
  }

  /** Return an object by its name, whether or not it exists now. @param {string} name */
  thing(name) {
    return this.table.things.get(name) ?? this.task.things.get(name);
  }

  /** Return the kind of an object; unknown objects are kinds of their own. @param {string} name */
  kindOf(name) {
    return this.thing(name)?.kind ?? name;
  }

  /** Return whether play can create or delete an object. @param {string} name */
  isTransient(name) {
    return this.task.transient.has(this.thing(name)?.type);
  }

  /** @param {string} name */
  exists(name) {
    return !this.isTransient(name) || this._isMarked(`${EXISTS}(${name})`);
  }

  /**
   * Return whether a fact is true. A fact about an object that does not exist is false.
   * @param {string} predicate @param {string[]} names
   */
  holds(predicate, ...names) {
    const atom = atomName([predicate, ...names]);
    if (this.table.position.has(atom)) return this._isMarked(atom);
    return this.task.staticNames.has(atom) && names.every((name) => this.exists(name));
  }

  /** @param {string} atom */
  _isMarked(atom) {
    const position = this.table.position.get(atom);
    return position !== undefined && this._facts[position] === 1;
  }

  /** Return the true atoms of a predicate. @param {string} predicate @returns {Atom[]} */
  truths(predicate) {
    if (!this._truths) {
      this._truths = new Map();
      for (let i = 0; i < this._facts.length; i++) {
        const atom = this.table.atoms[i];
        if (this._facts[i]) append(this._truths, atom[0], atom);
      }
    }
    let found = this._truths.get(predicate);
    if (!found) {
      const fixed = this.task.statics.get(predicate) ?? [];
      found = fixed.filter(([, ...names]) => names.every((name) => this.exists(name)));
      this._truths.set(predicate, found);
    }
    return found;
  }

  /** Return every true atom, sorted. */
  atoms() {
    if (!this._atoms) {
      const predicates = [...this.task.predicates.keys()];
      this._atoms = predicates.flatMap((each) => this.truths(each)).sort(byNames);
    }
    return this._atoms;
  }

  /**
   * Return for how many more steps a player is walking or working and cannot act.
   * @param {string | null} player
   */
  busySteps(player) {
    return (player !== null && this._busy.get(player)) || 0;
  }

  /** @param {string} label */
  effect(label) {
    return effectOf(this.task, label, (name) => this.kindOf(name));
  }

  /** Return the progress of all counting effects, in order of creation. */
  progress() {
    this._progress ??= progressOf(this);
    return this._progress;
  }
}

/**
 * Change the values of a state to those after a step.
 * @param {ReturnType<State["values"]>} values @param {any} delta
 */
export function advance(values, delta) {
  const { timers, orders: open } = values;
  const table = values.table.extended(delta.objects ?? [], delta.atoms ?? []);
  if (table !== values.table) {
    const facts = new Uint8Array(table.atoms.length);
    facts.set(values.facts);
    Object.assign(values, { table, facts });
  }
  mark(values.facts, delta.add ?? [], 1);
  mark(values.facts, delta.remove ?? [], 0);
  for (const [label, counters] of Object.entries(delta.timers ?? {})) {
    if (counters === null) timers.delete(label);
    else timers.set(label, checked(table, label, counters));
  }
  if (delta.busy) values.busy = busyOf(delta);
  if (open) values.orders = orders(delta) ?? { ...open, time: open.time + 1 };
  values.step = delta.step;
}

/** @param {Uint8Array} facts @param {any[]} positions @param {0 | 1} value */
function mark(facts, positions, value) {
  for (const position of positions) {
    if (!(position >= 0 && position < facts.length)) throw new Error(`no atom ${position}`);
    facts[position] = value;
  }
}

/**
 * Return the counters of an effect, which must exist and have as many as the task says.
 * @param {Table} table @param {string} label @param {number[]} counters
 */
function checked({ task, things }, label, counters) {
  const { nodes } = effectOf(task, label, (name) => things.get(name)?.kind ?? name);
  if (nodes.length !== counters.length) throw new Error(`invalid counters of ${label}`);
  return counters;
}

/** @param {any} message */
const busyOf = ({ busy }) =>
  new Map(Object.entries(busy).map(([player, steps]) => [player, Number(steps)]));

/**
 * Return the orders of a message; null if it has none.
 * @param {any} message @returns {Orders | null}
 */
function orders(message) {
  if (!message.orders) return null;
  const [time, open, arrived, score, served, expired] = message.orders;
  const listed = open.map((/** @type {[number, number]} */ [number, due]) => ({ number, due }));
  return { time, open: listed, arrived, score, served, expired };
}

/** Compare lists of names. @param {string[]} a @param {string[]} b */
export function byNames(a, b) {
  for (let i = 0; i < a.length && i < b.length; i++) {
    if (a[i] !== b[i]) return byText(a[i], b[i]);
  }
  return a.length - b.length;
}
