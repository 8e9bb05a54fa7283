/**
 * Special effects bound to objects, their progress, and their updates in one step.
 *
 * The page receives states and steps none itself. The updates serve one question only: whether an
 * action would interrupt work that goes on by itself.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Atom} Atom
 * @typedef {import("./task.js").EffectDef} EffectDef
 * @typedef {{atom: Atom, expected: boolean}} Literal
 * @typedef {{
 *   type: string, counts: "" | "steps" | "performances", slot: number, subject: string,
 *   total: number, conditions: Literal[], fx: Literal[], nested: Node[], definition: EffectDef,
 *   binding: Map<string, string>,
 * }} Node
 * @typedef {{
 *   label: string, action: string, args: string[], root: Node, nodes: Node[],
 * }} Effect
 * @typedef {{
 *   task: Task, timers: Map<string, number[]>, holds: (predicate: string, ...names: string[]) =>
 *   boolean, effect: (label: string) => Effect,
 * }} View A state, or what a step would make of it.
 * @typedef {{
 *   action: string, subject: string, arguments: string[], done: number, total: number,
 *   timed: boolean, running: boolean,
 * }} Progress
 */
import { bindingOf } from "./actions.js";
import { atomName, bound, isInstant, own } from "./task.js";

const [PAUSED, HOLDING, DONE] = [0, 1, -1];
/** Largest number of effects that a task keeps. */
const MAX_KEPT = 5000;

/** @type {WeakMap<Task, Map<string, Effect>>} */
const known = new WeakMap();

/**
 * Return the effect with a label such as `cook.0(patty1,stove1)`.
 * @param {Task} task @param {string} label @param {(name: string) => string} kindOf
 * @returns {Effect}
 */
export function effectOf(task, label, kindOf) {
  let effects = known.get(task);
  if (!effects) known.set(task, (effects = new Map()));
  const found = effects.get(label);
  if (found) return found;
  const [, action, index, names] = /^(.*)\.(\d+)\((.*)\)$/.exec(label) ?? [];
  const schema = task.schemaOf.get(action)?.effects[Number(index)];
  const args = names ? names.split(",") : [];
  if (!schema || schema.variables.length !== args.length) throw new Error(`no effect ${label}`);
  const binding = new Map(schema.variables.map((name, i) => [name, args[i]]));
  /** @type {Node[]} */
  const nodes = [];
  const root = nodeOf(schema.definition, binding, task, kindOf, nodes);
  const effect = { label, action, args, root, nodes };
  if (effects.size >= MAX_KEPT) effects.clear();
  effects.set(label, effect);
  return effect;
}

/**
 * @param {EffectDef} definition @param {Map<string, string>} binding @param {Task} task
 * @param {(name: string) => string} kindOf @param {Node[]} nodes @returns {Node}
 */
function nodeOf(definition, binding, task, kindOf, nodes) {
  const { type, param, conditions, fx, sfx, created } = definition;
  const counts = type === "delayed" ? "steps" : type === "repetitive" ? "performances" : "";
  const subject = binding.get(param) ?? param;
  /** @type {Node} */
  const node = {
    type,
    counts,
    slot: nodes.length,
    subject,
    total: counts ? total(definition, counts, subject, task, kindOf) : 0,
    conditions: literals(conditions, binding),
    // A creation's results mention an object that has no name before the creation happens.
    fx: created ? [] : literals(fx, binding),
    nested: [],
    definition,
    binding,
  };
  nodes.push(node);
  if (!isInstant(definition)) {
    node.nested = sfx.map((each) => nodeOf(each, binding, task, kindOf, nodes));
  }
  return node;
}

/**
 * Return conditions or results about the objects of a binding.
 * @param {import("./task.js").Condition[]} all @param {Map<string, string>} binding
 * @returns {Literal[]}
 */
const literals = (all, binding) =>
  all.map((each) => ({ atom: bound(each, binding), expected: each.is_true }));

/**
 * Return the number of updates after which a counting effect takes place.
 * @param {EffectDef} definition @param {string} counts @param {string} subject @param {Task} task
 * @param {(name: string) => string} kindOf @returns {number}
 */
function total(definition, counts, subject, task, kindOf) {
  const table = own(task.problem.config, definition.config ?? "");
  const steps =
    own(table, subject) ?? own(table, kindOf(subject)) ?? own(table, "default") ??
    definition.default;
  // The step that starts a delay has a passive update too.
  return counts === "steps" ? steps * task.profile.delayFactor + 1 : Math.max(1, steps);
}

/**
 * Return the labels of the effects that an action starts.
 * @param {import("./actions.js").Action} action
 */
export function labelsOf(action) {
  const { schema } = action;
  const started = schema.effects.slice(0, schema.started);
  return started.map((_, i) => labelOf(schema, i, bindingOf(action)));
}

/**
 * @param {import("./task.js").Schema} schema @param {number} index
 * @param {Map<string, string>} binding
 */
function labelOf(schema, index, binding) {
  return `${schema.name}.${index}(${schema.effects[index].variables.map((v) => binding.get(v))})`;
}

/**
 * Return whether an effect is active; a conditional one is not while its condition fails.
 * @param {Effect} effect @param {number[]} counters
 */
export const runs = ({ root }, counters) => root.type !== "conditional" || counters[0] === HOLDING;

/**
 * Return the progress of all counting effects, in order of creation.
 * @param {View} view @returns {Progress[]}
 */
export function progressOf(view) {
  return [...view.timers].flatMap(([label, counters]) => {
    const effect = view.effect(label);
    return effect.nodes
      .filter(({ counts, slot }) => counts && counters[slot] >= 0)
      .map(({ subject, slot, total, counts }) => ({
        action: effect.action,
        subject,
        arguments: effect.args,
        done: counters[slot],
        total,
        timed: counts === "steps",
        running: runs(effect, counters),
      }));
  });
}

/** View of a state after a step: the facts that changed, and the timers. */
export class Stepped {
  /**
   * @param {View} state
   * @param {import("./actions.js").Action | null} action Action of one player, if any acts.
   */
  constructor(state, action) {
    this.task = state.task;
    this.timers = new Map([...state.timers].map(([label, counters]) => [label, [...counters]]));
    this._state = state;
    /** @type {Map<string, boolean>} */
    this._written = new Map();
    /** @type {Set<string>} */
    this._deleted = new Set();
    /** @type {string[]} */
    this._started = [];
    if (action) {
      this._write(literals(action.schema.definition.immediate_fx, bindingOf(action)));
      for (const label of labelsOf(action)) this._update(label, true);
      this._settle();
    }
    for (const label of [...this.timers.keys()]) this._update(label, false);
    this._settle();
    for (const [label, counters] of this.timers) {
      if (counters[0] === DONE) this.timers.delete(label);
    }
  }

  /** @param {string} label */
  effect(label) {
    return this._state.effect(label);
  }

  /** @param {string} predicate @param {string[]} names */
  holds(predicate, ...names) {
    if (names.some((name) => this._deleted.has(name))) return false;
    const written = this._written.get(atomName([predicate, ...names]));
    return written ?? this._state.holds(predicate, ...names);
  }

  /** Make facts true and false; an atom in both roles becomes true. @param {Literal[]} results */
  _write(results) {
    for (const wanted of [false, true]) {
      for (const { atom, expected } of results) {
        if (expected === wanted) this._written.set(atomName(atom), expected);
      }
    }
  }

  /** @param {Effect} effect */
  _concernsDeleted(effect) {
    return effect.args.some((name) => this._deleted.has(name));
  }

  /**
   * @param {string} label
   * @param {boolean} active True for an update caused by performing the effect's action.
   */
  _update(label, active) {
    const effect = this.effect(label);
    if (this._concernsDeleted(effect)) return;
    const counters = this.timers.get(label) ?? effect.nodes.map(() => 0);
    this.timers.set(label, counters);
    this._updateNode(effect.root, counters, active);
  }

  /** Add the effects that a creation or deletion started; drop those of deleted objects. */
  _settle() {
    for (const label of this._started.splice(0)) {
      if (!this.timers.has(label)) this.timers.set(label, this.effect(label).nodes.map(() => 0));
    }
    for (const label of this.timers.keys()) {
      if (this._concernsDeleted(this.effect(label))) this.timers.delete(label);
    }
  }

  /**
   * @param {Node} node @param {number[]} counters @param {boolean} active
   * @returns {boolean} Whether the node has completed.
   */
  _updateNode(node, counters, active) {
    if (counters[node.slot] === DONE) return true;
    const finished = this._advance(node, counters, active);
    if (finished) counters[node.slot] = DONE;
    return finished;
  }

  /** @param {Node} node @param {number[]} counters @param {boolean} active */
  _advance(node, counters, active) {
    if (isInstant(node)) return this._instant(node);
    if (node.type === "conditional") {
      if (!node.conditions.every(({ atom, expected }) => this.holds(...atom) === expected)) {
        if (counters[node.slot] === HOLDING) {
          counters[node.slot] = PAUSED;
          this._write(node.fx.map(({ atom, expected }) => ({ atom, expected: !expected })));
        }
        return false;
      }
      counters[node.slot] = HOLDING;
      this._write(node.fx);
    } else if (counters[node.slot] < node.total) {
      // A delay counts the steps that pass, a repetition the performances of its action.
      if (active !== (node.counts === "performances")) return false;
      counters[node.slot] += 1;
      if (counters[node.slot] < node.total) return false;
      this._write(node.fx);
    }
    // All are updated even if an early one is unfinished: nested effects run in parallel.
    return node.nested.map((each) => this._updateNode(each, counters, active)).every(Boolean);
  }

  /** @param {Node} node */
  _instant({ definition, binding, fx, subject }) {
    const { created, sfx } = definition;
    let names = binding;
    if (created) {
      // The name is the server's choice, and the question does not depend on it.
      names = new Map(binding).set(created.param, `${created.name}*`);
      this._write(literals(definition.fx, names));
    } else {
      this._write(fx);
      this._deleted.add(subject);
    }
    for (const schema of this.task.schemas) {
      for (const [i, each] of schema.effects.entries()) {
        if (sfx.includes(each.definition)) this._started.push(labelOf(schema, i, names));
      }
    }
    return true;
  }
}
