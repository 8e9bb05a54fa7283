/**
 * Near misses: the action that an input most nearly means, and what has to be done before it.
 *
 * @typedef {import("./task.js").Schema} Schema
 * @typedef {import("./state.js").State} State
 * @typedef {import("./scene.js").Placed} Placed
 * @typedef {import("./actions.js").Action} Action
 * @typedef {import("./actions.js").Unmet} Unmet
 * @typedef {import("./words.js").Wording} Wording
 * @typedef {{schema: Schema, parameter: string | null}} Binding Action that an input may mean, and
 *   the parameter that the input sets, if any.
 * @typedef {{
 *   state: State, me: string, placed: Map<string, Placed>, at: string | null, held: Set<string>,
 * }} Situation State as one player meets it: where the player stands and what it holds.
 * @typedef {number[]} Rank Sort key of an action that is not possible now; the least is the
 *   nearest miss. Its fields, most important first: 0 for a walk to an occupied place; the number
 *   of conditions that no action can change at this place; 1 if the action would change nothing;
 *   1 if no held object takes part; 1 if it lacks several conditions and does not serve the goal;
 *   minus the number of objects involved; the number of unmet conditions.
 * @typedef {{action: Action | null, words: string, advice: boolean}} NearMiss
 */
import { actionOf, bindingOf, unmet as unmetOf } from "./actions.js";
import { scene } from "./scene.js";
import { atomName, byText } from "./task.js";
import { capitalised } from "./words.js";
import { changesSomething, workInProgress } from "./work.js";

/** Bound of the time that a key press takes in a large kitchen. */
const MAX_ATTEMPTS = 2000;
/** An action that lacks more than this is too far off to be hinted at. */
const MAX_UNMET = 2;

/** @param {State} state @param {string} me @returns {Situation} */
export function situationOf(state, me) {
  const placed = scene(state);
  const at = placed.get(me)?.at ?? null;
  return { state, me, placed, at, held: new Set(thingsUpon(me, placed)) };
}

/**
 * Return what lies on or is in an object, the uppermost first.
 * @param {string} target @param {Map<string, Placed>} placed @param {number} depth
 * @returns {string[]}
 */
export function thingsUpon(target, placed, depth = 0) {
  // A custom domain can put objects into each other in a circle.
  if (depth > placed.size) return [];
  const upon = [...placed.values()].filter(({ host }) => host === target);
  upon.sort((a, b) => b.level - a.level);
  return upon.flatMap(({ thing }) => [thing.name, ...thingsUpon(thing.name, placed, depth + 1)]);
}

/** Finder of the nearest miss of a player's input, in that player's wording. */
export class NearMisses {
  /** @param {Wording} wording */
  constructor(wording) {
    this._task = wording.task;
    this._words = wording;
    this._preparation = wording.preparation;
  }

  /**
   * Return the action nearest to being possible, or the work that must come before it.
   * @param {Situation} situation @param {Binding[]} bindings
   * @param {string[]} meant Objects the input may be about, the most likely first.
   * @param {boolean} atWork True while work goes on here. Actions that can never follow it are
   *   left out.
   * @returns {NearMiss}
   */
  nearest(situation, bindings, meant, atWork) {
    const near = nearby(situation, meant);
    /** @type {{rank: Rank, action: Action, unmet: Unmet[]} | null} */
    let found = null;
    // Objects that do not exist yet need hints of their own, since no action with them can be
    // tried.
    /** @type {{rank: Rank, words: string} | null} */
    let unmade = null;
    for (const binding of bindings) {
      for (const names of this._arguments(situation, binding, meant, near)) {
        const missing = names.filter((name) => name === null).length;
        if (missing === 0) {
          const action = actionOf(binding.schema, /** @type {string[]} */ (names));
          const unmet = unmetOf(situation.state, action);
          const rank = this._rank(situation, action, unmet, meant);
          if (!rank || (atWork && rank[1])) continue;
          if (!found || compare(rank, found.rank) < 0) found = { rank, action, unmet };
        } else if (missing === 1) {
          const known = new Map(binding.schema.parameters.map(([name], i) => [name, names[i]]));
          const rank = this._rankOfUnmade(situation, binding.schema, known, meant);
          const words = rank && this._before(situation.state, binding.schema, known);
          if (!rank || !words) continue;
          const order = unmade ? compare(rank, unmade.rank) || byText(words, unmade.words) : -1;
          if (order < 0) unmade = { rank, words };
        }
      }
    }
    if (unmade && (!found || compare(unmade.rank, found.rank) < 0)) {
      return { action: null, words: capitalised(unmade.words), advice: true };
    }
    if (!found) return this._nothing(situation, bindings, meant);
    const { rank, action, unmet } = found;
    const way = capitalised(this._words.way(action, unmet, situation.state));
    const does = capitalised(this._words.action(action, situation.state));
    return { action, words: rank[0] ? `${does}? ${way}` : way, advice: true };
  }

  /**
   * Return what an empty place is for, or that there is nothing to do.
   * @param {Situation} situation @param {Binding[]} bindings @param {string[]} meant
   * @returns {NearMiss}
   */
  _nothing({ state, me, at, held }, bindings, meant) {
    if (workInProgress(state).some((row) => row.running && meant.includes(row.subject))) {
      return { action: null, words: this._words.language.work.under_way, advice: true };
    }
    const [there] = meant;
    if (meant.length === 1 && !held.size && there === at) {
      const fitting = bindings.filter((each) => this.isFor(each, there));
      const words = this._words.here(fitting.map(({ schema }) => schema));
      if (words) return { action: null, words: capitalised(words), advice: true };
    }
    const where =
      there !== undefined && there !== me ? `at ${this._words.thing(there, state)}` : "here";
    return { action: null, words: `nothing to do ${where}`, advice: false };
  }

  /**
   * Return whether an action needs such a station, and objects that exist in this task.
   * @param {Binding} binding @param {string} station
   */
  isFor({ schema, parameter }, station) {
    const { statics, staticNames } = this._task;
    const needs = schema.definition.precons.filter((each) => this._task.isStatic(each.predicate));
    const here = needs.filter(({ params }) => params.length === 1 && params[0] === parameter);
    return (
      schema.parameters.length - Number(schema.player) > 1 &&
      here.length > 0 &&
      here.every(({ predicate }) => staticNames.has(atomName([predicate, station]))) &&
      needs.every(({ predicate, is_true }) => !is_true || statics.has(predicate))
    );
  }

  // Actions that can be tried

  /**
   * Return the rank of an action; null if it is not worth a hint.
   * @param {Situation} situation @param {Action} action @param {Unmet[]} unmet
   * @param {string[]} meant @returns {Rank | null}
   */
  _rank({ state, me, at, held }, action, unmet, meant) {
    if (!unmet.length || unmet.length > MAX_UNMET) return null;
    const never = unmet.filter((each) => this._isForEver(each, state));
    if (never.length > 1 || never.some((each) => this._isNowhere(each))) return null;
    const vain = !changesSomething(state, action);
    if (vain && unmet.every((each) => each.expected)) return null;
    const here = isHere(meant, at);
    // The place is unfit, and no object could be carried elsewhere.
    const unfit = action.args.every((name) => name === me || name === meant[0]);
    if (never.length && here && unfit) return null;
    const aside = here && held.size > 0 && !action.args.some((name) => held.has(name));
    const known = bindingOf(action);
    const far = unmet.length > 1 && !this.leadsOn(action.schema, known, state);
    const free = new Set(unmet.map((each) => this._words.occupancy.neededFree(each)));
    const taken = action.destination !== null && free.size === 1 && free.has(meant[0]);
    return [!taken, never.length, vain, aside, far, -action.args.length, unmet.length].map(Number);
  }

  /**
   * Return whether no action can ever change an unmet condition.
   * @param {Unmet} unmet @param {State} state
   */
  _isForEver({ predicate, objects, expected }, state) {
    if (this._task.isStatic(predicate)) return true;
    return predicate !== "" && expected && !this._preparation.canBecome(predicate, objects, state);
  }

  /** Return whether a fixed condition holds for nothing in this task. @param {Unmet} unmet */
  _isNowhere({ predicate }) {
    return this._task.isStatic(predicate) && !this._task.statics.has(predicate);
  }

  // Actions with something that does not exist yet

  /**
   * Return the rank of an action that lacks one object, as `_rank` does.
   * @param {Situation} situation @param {Schema} schema @param {Map<string, string | null>} known
   * @param {string[]} meant @returns {Rank | null}
   */
  _rankOfUnmade({ state, at, held }, schema, known, meant) {
    let missing = 0;
    for (const { predicate, params, is_true } of schema.definition.precons) {
      const names = params.map((each) => known.get(each) ?? null);
      if (names.includes(null)) continue;
      if (state.holds(predicate, .../** @type {string[]} */ (names)) === is_true) continue;
      if (this._task.isStatic(predicate)) return null;
      missing += 1;
    }
    if (missing > MAX_UNMET || !this.leadsOn(schema, known, state)) return null;
    const things = [...known.values()];
    const aside =
      isHere(meant, at) && held.size > 0 && !things.some((name) => name && held.has(name));
    return [1, 0, 0, Number(aside), 0, -known.size, missing + 1];
  }

  /**
   * Return the work that makes the missing object, in words.
   * @param {State} state @param {Schema} schema @param {Map<string, string | null>} known
   */
  _before(state, schema, known) {
    for (const { predicate, params, is_true } of schema.definition.precons) {
      const names = params.map((each) => known.get(each) ?? null);
      if (!is_true || !names.includes(null) || names.length < 2) continue;
      const work = this._preparation.workFor(predicate, names, state);
      if (work) return this._words.first(work, state);
    }
    return "";
  }

  /**
   * Return whether an action achieves a goal term for objects of these kinds. A missing object may
   * be of any kind.
   * @param {Schema} schema @param {Map<string, string | null>} known @param {State} state
   * @param {string | null} about Object that the term must be about.
   */
  leadsOn(schema, known, state, about = null) {
    const results = schema.definition.immediate_fx.filter(({ params, is_true }) =>
      is_true && (about === null || params.some((each) => known.get(each) === about)));
    return results.some(({ predicate, params }) => {
      const kinds = params.map((each) => {
        const name = known.get(each) ?? null;
        return name === null ? null : state.kindOf(name);
      });
      return this._task.goal.some(
        (term) =>
          term.predicate === predicate &&
          kinds.every((kind, i) => kind === null || kind === term.args[i]),
      );
    });
  }

  // Objects that actions may be about

  /**
   * Yield ways to fill an action's parameters with objects nearby. Null stands for an object that
   * is not nearby and can be made.
   * @param {Situation} situation @param {Binding} binding @param {string[]} meant
   * @param {string[]} near @returns {Generator<(string | null)[]>}
   */
  *_arguments({ state, me }, { schema, parameter }, meant, near) {
    /** @type {(string | null)[][]} */
    const choices = schema.parameters.map(([name, type], i) => {
      if (i === 0 && schema.player) return [me];
      const pool = name === parameter ? meant : near;
      const fitting = pool.filter((each) => state.thing(each)?.type === type);
      return fitting.length ? fitting : this._preparation.creates(type) ? [null] : [];
    });
    const count = choices.reduce((product, { length }) => product * length, 1);
    for (let n = 0; n < Math.min(count, MAX_ATTEMPTS); n++) {
      let rest = n;
      const names = choices.map(() => /** @type {string | null} */ (null));
      for (let i = choices.length - 1; i >= 0; i--) {
        names[i] = choices[i][rest % choices[i].length];
        rest = Math.floor(rest / choices[i].length);
      }
      if (new Set(names).size === names.length) yield names;
    }
  }
}

/** @param {string[]} meant @param {string | null} at */
const isHere = (meant, at) => (meant.length ? meant[0] === at : false);

/** @param {Rank} a @param {Rank} b */
function compare(a, b) {
  const i = a.findIndex((value, n) => value !== b[n]);
  return i < 0 ? 0 : a[i] - b[i];
}

/**
 * Return the player's station and hands, with everything that lies there or is held.
 * @param {Situation} situation @param {string[]} meant
 */
function nearby({ me, at, placed }, meant) {
  const hosts = [...(at === null ? [] : [at]), ...meant.slice(0, 1), me];
  return [...new Set(hosts.flatMap((host) => [host, ...thingsUpon(host, placed)]))];
}
