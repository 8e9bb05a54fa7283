// One recording: its states by step, its times, and what happened.

import { actionNamed } from "../rules/actions.js";
import { State, advance } from "../rules/state.js";

/** @typedef {import("../rules/task.js").Task} Task */
/**
 * @typedef {{step: number, ms: number, kind: string, seat: number, rest: any[]}} Entry
 * @typedef {{name: string, kind: string, controller: string}} Cook
 */

// Steps between two states that are kept from the beginning.
const EVERY = 64;
const MAX_KEPT = 256;

export class Reel {
  /** @param {Task} task @param {any} raw One of `recordings` in the page's data. */
  constructor(task, raw) {
    this.task = task;
    this.raw = raw;
    /** @type {number} The number of the last step. */
    this.last = raw.steps;
    this.label = String(raw.label);
    this.outcome = raw.outcome;
    /** @type {number[]} Milliseconds since the start, by step. */
    this.times = [0];
    for (const passed of raw.times) this.times.push(this.times[this.times.length - 1] + passed);
    /** @type {Entry[]} */
    this.log = raw.log.map((/** @type {any[]} */ [step, ms, kind, seat, ...rest]) =>
      ({ step, ms, kind, seat, rest }));
    for (const [step, ms, holds, seconds] of raw.pauses) {
      this.log.push({ step, ms, kind: "paused", seat: -1, rest: [holds, seconds] });
    }
    if (raw.outcome) {
      const ms = raw.outcome.seconds * 1000;
      this.log.push({ step: this.last, ms, kind: "ended", seat: -1, rest: [] });
    }
    // The order of equal entries stays the same.
    this.log.sort((a, b) => a.step - b.step || a.ms - b.ms);
    /** @type {Map<number, State>} */
    this.kept = new Map();
    /** @type {State[]} */
    this.keys = [];
    this.readKeys();
  }

  /** Read every 64th state. Most states between them are never needed. */
  readKeys() {
    const first = State.fromSnapshot(this.task, this.raw.snapshot);
    const values = first.values();
    this.keys = [first];
    this.raw.deltas.forEach((/** @type {any} */ delta, /** @type {number} */ place) => {
      advance(values, { ...delta, step: place + 1 });
      if (values.step % EVERY) return;
      const { table, facts, timers } = values;
      this.keys.push(new State(table, { ...values, facts: facts.slice(), timers: new Map(timers) }));
    });
  }

  /** Return the state after a step. @param {number} step @returns {State} */
  state(step) {
    let from = step;
    const first = step - (step % EVERY);
    while (from > first && !this.kept.has(from)) from -= 1;
    let state = from === first ? this.keys[first / EVERY] : this.kept.get(from);
    if (!state) throw new Error(`no step ${step}`);
    while (from < step) {
      from += 1;
      state = state.after({ ...this.raw.deltas[from - 1], step: from });
      this.keep(from, state);
    }
    return state;
  }

  /** @param {number} step @param {State} state */
  keep(step, state) {
    if (this.kept.size >= MAX_KEPT) {
      for (const old of [...this.kept.keys()].slice(0, MAX_KEPT / 2)) this.kept.delete(old);
    }
    this.kept.set(step, state);
  }

  /** Return the last step at a time, or before it. @param {number} ms */
  stepAt(ms) {
    return below(this.times.length, (step) => this.times[step] <= ms) - 1;
  }

  /** Return the number of events up to a step. @param {number} step */
  eventsUntil(step) {
    return below(this.log.length, (place) => this.log[place].step <= step);
  }

  /** Return who has each seat in a step. @param {number} step @returns {Cook[]} */
  cooks(step) {
    const { seats } = this.raw;
    const row = seats[Math.max(0, below(seats.length, (place) => seats[place][0] <= step) - 1)];
    return row[1].map((/** @type {string[]} */ [name, kind, controller]) =>
      ({ name, kind, controller }));
  }

  /** Return an action by its number. @param {number} number */
  action(number) {
    const [name, ...args] = this.raw.actions[number];
    return actionNamed(this.task, name, args);
  }

  /** Return the action of each seat that was applied in a step. @param {number} step */
  moves(step) {
    /** @type {Map<number, number>} */
    const found = new Map();
    const row = step ? this.raw.moves[step - 1] : [];
    for (let i = 0; i < row.length; i += 2) found.set(row[i], row[i + 1]);
    return found;
  }

  /** Return the letter of what a seat did in a step. @param {number} seat @param {number} step */
  activity(seat, step) {
    return step ? this.raw.lanes[seat][step - 1] : "?";
  }
}

/**
 * Return how many numbers from 0 hold a condition that is true up to some number.
 * @param {number} count @param {(place: number) => boolean} holds
 */
export function below(count, holds) {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(middle)) low = middle + 1;
    else high = middle;
  }
  return low;
}
