/**
 * Work: what has to be done first, what is going on, and which actions still change something.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Schema} Schema
 * @typedef {import("./task.js").Condition} Condition
 * @typedef {import("./task.js").EffectDef} EffectDef
 * @typedef {import("./state.js").State} State
 * @typedef {import("./actions.js").Action} Action
 * @typedef {import("./actions.js").Unmet} Unmet
 * @typedef {import("./effects.js").View} View
 * @typedef {import("./effects.js").Node} Node
 * @typedef {{schema: Schema, binding: Map<string, string>, places: string[]}} Work Action that
 *   makes a fact true. `places` are the stations for it; none if any station will do.
 * @typedef {{
 *   schema: Schema, fact: Condition, needs: Condition[], created: EffectDef["created"],
 * }} Maker Action that makes a fact true later.
 */
import { changes, validActions } from "./actions.js";
import { labelsOf, progressOf, runs, Stepped } from "./effects.js";
import { scene } from "./scene.js";
import { atomName, bound, isInstant } from "./task.js";

/** Index of the work in one task. */
export class Preparation {
  /** @param {Task} task */
  constructor(task) {
    this._task = task;
    this.occupancy = new Occupancy(task);
    this._makers = task.schemas.flatMap((each) => [...makers(each, each.definition.sfx, [], null)]);
    this._created = new Set(this._makers.flatMap(({ created }) => (created ? created.type : [])));
  }

  /** Return whether some work creates objects of a type. @param {string} type */
  creates(type) {
    return this._created.has(type);
  }

  /**
   * Return whether any action can make a fact true.
   * @param {string} predicate @param {string[]} objects @param {State} state
   */
  canBecome(predicate, objects, state) {
    const atOnce = this._task.schemas.some(({ definition }) =>
      definition.immediate_fx.some((each) => each.predicate === predicate && each.is_true),
    );
    return atOnce || this.workFor(predicate, objects, state) !== null;
  }

  /**
   * Return the work that makes a fact true.
   * @param {string} predicate
   * @param {(string | null)[]} objects Null stands for the object that the work creates.
   * @param {State} state @returns {Work | null}
   */
  workFor(predicate, objects, state) {
    for (const maker of this._makers) {
      const { fact, created, schema } = maker;
      if (fact.predicate !== predicate || fact.params.length !== objects.length) continue;
      /** @type {Map<string, string>} */
      const binding = new Map();
      const fits = fact.params.map((parameter, i) => {
        const name = objects[i];
        if (created && parameter === created.param) {
          return name === null || state.kindOf(name) === created.name;
        }
        if (name !== null) binding.set(parameter, name);
        return name !== null;
      });
      if (!fits.every(Boolean) || !this._mayBeDone(maker, binding)) continue;
      return { schema, binding, places: this._places(schema, binding) };
    }
    return null;
  }

  /**
   * Return whether work has been started and continues without a player.
   * @param {State} state @param {Work} work
   */
  isUnderWay(state, { schema, binding }) {
    return state.progress().some(({ action, running, timed, subject, arguments: names }) => {
      const about = new Set([subject, ...names]);
      const same = action === schema.name && running && timed;
      return same && [...binding.values()].every((name) => about.has(name));
    });
  }

  /**
   * Return whether no static condition rules the work out.
   * @param {Maker} maker @param {Map<string, string>} binding
   */
  _mayBeDone({ schema, needs }, binding) {
    return [...schema.definition.precons, ...needs].every((condition) => {
      if (!this._task.isStatic(condition.predicate)) return true;
      if (!condition.params.every((name) => binding.has(name))) return true;
      const atom = atomName(bound(condition, binding));
      return this._task.staticNames.has(atom) === condition.is_true;
    });
  }

  /**
   * Return the stations for an action that needs a particular kind of station.
   * @param {Schema} schema @param {Map<string, string>} binding
   */
  _places(schema, binding) {
    const { floor, staticNames } = this._task;
    const needs = schema.definition.precons.filter(
      ({ predicate, params, is_true }) =>
        this._task.isStatic(predicate) && is_true && params.length === 1 && !binding.has(params[0]),
    );
    return [...floor.stations.keys()].filter((name) =>
      needs.some(({ predicate }) => staticNames.has(atomName([predicate, name]))),
    );
  }
}

/** @type {WeakMap<Task, Preparation>} */
const preparations = new WeakMap();

/** Return the index of a task's work. @param {Task} task */
export function preparationOf(task) {
  const found = preparations.get(task) ?? new Preparation(task);
  preparations.set(task, found);
  return found;
}

/**
 * @param {Schema} schema @param {EffectDef[]} effects @param {Condition[]} needs
 * @param {EffectDef["created"]} created @returns {Generator<Maker>}
 */
function* makers(schema, effects, needs, created) {
  for (const effect of effects) {
    const more = [...needs, ...effect.conditions];
    const made = effect.created ?? created;
    for (const fact of effect.fx) {
      if (fact.is_true) yield { schema, fact, needs: more, created: made };
    }
    yield* makers(schema, effect.sfx, more, made);
  }
}

/** Rules of a domain about standing at stations. */
export class Occupancy {
  /** @param {Task} task */
  constructor(task) {
    this._standing = new Set(
      task.layout.flatMap(({ when, predicate }) => (when === "faces" ? predicate : [])),
    );
    /** @type {Map<string, boolean>} Predicates that a walk changes, with their values before. */
    this._free = new Map();
    for (const { definition } of task.schemas) {
      const { travel, immediate_fx: results } = definition;
      for (const { predicate, params, is_true } of travel ? results : []) {
        if (params.length === 1 && params[0] === travel?.[1]) this._free.set(predicate, !is_true);
      }
    }
  }

  /**
   * Return whether a predicate says that a player, or no player, stands somewhere.
   * @param {string} predicate
   */
  isAboutStanding(predicate) {
    return this._standing.has(predicate) || this._free.has(predicate);
  }

  /**
   * Return the station that must be free, if that is what the condition asks for.
   * @param {Unmet} unmet
   */
  neededFree({ kind, predicate, objects, expected }) {
    const asks = kind === "condition" && objects.length === 1;
    return asks && this._free.get(predicate) === expected ? objects[0] : null;
  }

  /** Return the players that stand at a station. @param {State} state @param {string} station */
  playersAt(state, station) {
    return [...scene(state)].flatMap(([name, { at }]) => (at === station ? name : []));
  }
}

/**
 * Return whether an action changes the state, now or later.
 *
 * Actions without any effects, such as waiting, count as useful: they are meant to do nothing.
 * @param {State} state @param {Action} action
 */
export function changesSomething(state, action) {
  const { added, removed } = changes(state, action);
  if (added.length || removed.length) return true;
  const labels = labelsOf(action);
  if (!labels.length) return !action.schema.definition.immediate_fx.length;
  // Starting an effect again that is already running does nothing, unless it counts repetitions.
  return labels.some((label) => {
    const effect = state.effect(label);
    const counters = state.timers.get(label);
    const repeats = effect.nodes.some(({ counts }) => counts === "performances");
    return (!counters || !runs(effect, counters) || repeats) && leadsOn(effect.root, state);
  });
}

/** @type {WeakMap<Action[], Action[]>} */
const useful = new WeakMap();

/**
 * Return the valid actions of a player that change something.
 * @param {State} state @param {string} player
 */
export function usefulActions(state, player) {
  const valid = validActions(state, player);
  const found = useful.get(valid) ?? valid.filter((action) => changesSomething(state, action));
  useful.set(valid, found);
  return found;
}

/** Return the progress of all work that still changes something. @param {View} view */
export function workInProgress(view) {
  const goingOn = new Set();
  for (const label of view.timers.keys()) {
    const { action, args, nodes } = view.effect(label);
    if (nodes.some((each) => each.counts && leadsOn(each, view))) goingOn.add(keyOf(action, args));
  }
  return progressOf(view).filter((row) => goingOn.has(keyOf(row.action, row.arguments)));
}

/**
 * Return whether an action interrupts work that continues without a player.
 * @param {State} state @param {Action} action
 */
export function endsWork(state, action) {
  const running = workInProgress(state).filter((row) => row.running && row.timed);
  if (!running.length) return false;
  // Work may end by itself in this step. Only a comparison shows what the action causes.
  const [then, without] = [action, null].map((each) => goesOn(new Stepped(state, each)));
  return running.some((row) => {
    const key = keyOf(row.action, row.arguments);
    return !(then.get(key) ?? !without.get(key));
  });
}

/** @param {View} view */
const goesOn = (view) =>
  new Map(workInProgress(view).map((row) => [keyOf(row.action, row.arguments), row.running]));

/** @param {string} action @param {string[]} names */
const keyOf = (action, names) => `${action}(${names})`;

/**
 * Return whether an effect tree still has something to change.
 *
 * Facts that a conditional effect asserts are not its purpose if other effects are nested in it.
 * @param {Node} node @param {View} view @returns {boolean}
 */
function leadsOn(node, view) {
  if (!isPossible(node, view.task)) return false;
  // Creating or deleting an object always changes something.
  if (isInstant(node)) return true;
  const later = node.nested.some((each) => leadsOn(each, view));
  if (node.nested.length && node.type === "conditional") return later;
  const sets = new Set(node.fx.flatMap(({ atom, expected }) => (expected ? atomName(atom) : [])));
  const news = node.fx.some(({ atom, expected }) => {
    return (expected || !sets.has(atomName(atom))) && view.holds(...atom) !== expected;
  });
  return news || later;
}

/**
 * Return whether fixed facts, or each other, do not rule the conditions of an effect out.
 * @param {Node} node @param {Task} task
 */
function isPossible({ conditions }, task) {
  const [required, forbidden] = [new Set(), new Set()];
  for (const { atom, expected } of conditions) {
    const [predicate, ...names] = atom;
    const literals = expected ? required : forbidden;
    if (!task.isStatic(predicate)) {
      literals.add(atomName(atom));
      continue;
    }
    // A fixed fact holds while its objects exist.
    const types = task.predicates.get(predicate) ?? [];
    const mortal = names.filter((_, i) => task.transient.has(types[i]));
    const holds = task.staticNames.has(atomName(atom));
    if (holds ? !expected && !mortal.length : expected) return false;
    for (const name of holds ? mortal : []) literals.add(`${name} exists`);
  }
  return ![...required].some((each) => forbidden.has(each));
}
