/**
 * Valid actions of a state, and the reasons why others are not.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Schema} Schema
 * @typedef {import("./task.js").Condition} Condition
 * @typedef {import("./state.js").State} State
 * @typedef {{
 *   name: string, args: string[], schema: Schema, player: string | null, key: string,
 *   origin: string | null, destination: string | null,
 * }} Action Action with its objects. `origin` and `destination` are the stations of a walk. Two
 *   actions are the same if their keys are equal.
 * @typedef {{
 *   kind: string, words: string, predicate: string, objects: string[], expected: boolean,
 * }} Unmet Reason why an action is rejected.
 * @typedef {{condition: Condition, test: boolean} | {parameter: number, type: string}} PlanStep
 *   Test of a condition whose objects are known, or a search for unknown ones.
 * @typedef {{
 *   state: State, plan: PlanStep[], numbers: Map<string, number>, args: string[],
 *   found: string[][], left: number,
 * }} Search
 */
import { atomName, bound } from "./task.js";

/** Most steps of the search for one action. A domain from elsewhere must not block the page. */
const MAX_TRIED = 100_000;
/** @type {WeakMap<Schema, PlanStep[]>} */
const plans = new WeakMap();
/** @type {WeakMap<State, Map<string, Action[]>>} */
const listed = new WeakMap();

/**
 * Return an action with its objects, in the order of its schema's parameters.
 * @param {Schema} schema @param {string[]} args @returns {Action}
 */
export function actionOf(schema, args) {
  const { travel } = schema.definition;
  const end = (/** @type {number} */ i) => {
    const index = travel ? schema.parameters.findIndex(([name]) => name === travel[i]) : -1;
    return args[index] ?? null;
  };
  return {
    name: schema.name,
    args,
    schema,
    player: schema.player ? args[0] : null,
    key: `${schema.name}(${args.join(", ")})`,
    origin: end(0),
    destination: end(1),
  };
}

/**
 * Return the action of a row such as `["move", "robot1", "table1", "table2"]`; null if unknown.
 * @param {Task} task @param {string} name @param {string[]} args
 */
export function actionNamed(task, name, args) {
  const schema = task.schemaOf.get(name);
  return schema && schema.parameters.length === args.length ? actionOf(schema, args) : null;
}

/** Return the objects of an action by parameter. @param {Action} action */
export function bindingOf({ schema, args }) {
  return new Map(schema.parameters.map(([name], i) => [name, args[i]]));
}

/**
 * Return the valid actions of a player, in the domain's order and then by object.
 * @param {State} state @param {string} player @returns {Action[]}
 */
export function validActions(state, player) {
  let known = listed.get(state);
  if (!known) listed.set(state, (known = new Map()));
  const found = known.get(player) ?? (state.busySteps(player) ? [] : search(state, player));
  known.set(player, found);
  return found;
}

/** @param {State} state @param {string} player */
function search(state, player) {
  const type = state.thing(player)?.type;
  return state.task.schemas.flatMap((schema) => {
    if (schema.player && schema.parameters[0][1] !== type) return [];
    const numbers = new Map(schema.parameters.map(([name], i) => [name, i]));
    /** @type {string[][]} */
    const found = [];
    /** @type {string[]} */
    const args = new Array(schema.parameters.length).fill("");
    if (schema.player) args[0] = player;
    const plan = planOf(schema, state.task);
    fill({ state, plan, numbers, args, found, left: MAX_TRIED }, 0);
    const rank = (/** @type {string} */ name) => state.table.rank.get(name) ?? -1;
    found.sort((a, b) => {
      const i = a.findIndex((name, n) => name !== b[n]);
      return i < 0 ? 0 : rank(a[i]) - rank(b[i]);
    });
    return found.map((each) => actionOf(schema, each));
  });
}

/**
 * Collect the ways to fill the unknown arguments, which are empty texts.
 * @param {Search} search @param {number} index
 */
function fill(search, index) {
  const { state, plan, numbers, args, found } = search;
  if (search.left-- <= 0) return;
  if (index === plan.length) {
    if (args.every((name) => state.exists(name))) found.push([...args]);
    return;
  }
  const step = plan[index];
  if ("parameter" in step) {
    for (const { name, type } of state.objects.values()) {
      if (type !== step.type) continue;
      args[step.parameter] = name;
      fill(search, index + 1);
    }
    args[step.parameter] = "";
    return;
  }
  const { predicate, params, is_true } = step.condition;
  const places = params.map((name) => /** @type {number} */ (numbers.get(name)));
  if (step.test) {
    if (state.holds(predicate, ...places.map((i) => args[i])) === is_true) fill(search, index + 1);
    return;
  }
  const unknown = places.filter((i) => !args[i]);
  for (const atom of state.truths(predicate)) {
    if (!places.every((i, n) => !args[i] || args[i] === atom[n + 1])) continue;
    places.forEach((i, n) => (args[i] = atom[n + 1]));
    // One parameter can occur twice in a condition.
    if (places.every((i, n) => args[i] === atom[n + 1])) fill(search, index + 1);
    for (const i of unknown) args[i] = "";
  }
}

/**
 * Return the order in which to test an action's conditions and to search for its objects.
 * @param {Schema} schema @param {Task} task
 */
function planOf(schema, task) {
  const known = plans.get(schema);
  if (known) return known;
  /** @type {PlanStep[]} */
  const plan = [];
  const bound = new Set(schema.player ? [schema.parameters[0][0]] : []);
  const left = [...schema.definition.precons];
  while (left.length || bound.size < schema.parameters.length) {
    const i = next(left, bound, task);
    if (i >= 0) {
      const [condition] = left.splice(i, 1);
      plan.push({ condition, test: condition.params.every((name) => bound.has(name)) });
      for (const name of condition.params) bound.add(name);
    } else {
      const parameter = schema.parameters.findIndex(([name]) => !bound.has(name));
      const [name, type] = schema.parameters[parameter];
      plan.push({ parameter, type });
      bound.add(name);
    }
  }
  plans.set(schema, plan);
  return plan;
}

/**
 * Return the index of the condition that leaves the fewest choices; -1 if none can be next.
 * @param {Condition[]} conditions @param {Set<string>} known @param {Task} task
 */
function next(conditions, known, task) {
  const costs = conditions.map(({ predicate, params, is_true }) => {
    const unknown = new Set(params.filter((name) => !known.has(name))).size;
    if (!unknown) return 0;
    if (!is_true) return Infinity;
    const near = unknown < new Set(params).size;
    // Facts about a known object are few, and facts that can change are fewer than fixed ones.
    return unknown + (near ? 0 : 10) + (task.isStatic(predicate) ? 5 : 0);
  });
  const least = Math.min(...costs);
  return least < Infinity ? costs.indexOf(least) : -1;
}

// Reasons

/**
 * Return the reasons why an action does not apply; none if it does.
 * @param {State} state @param {Action} action @returns {Unmet[]}
 */
export function unmet(state, action) {
  const { player, args, schema } = action;
  /** @type {Unmet[]} */
  const found = [];
  const steps = state.busySteps(player);
  if (player && steps) {
    const words = `${player} is busy for ${steps} more step${steps > 1 ? "s" : ""}`;
    found.push({ kind: "busy", words, predicate: "", objects: [player], expected: true });
  }
  for (const name of args.filter((each) => !state.exists(each))) {
    const words = `${name} does not exist`;
    found.push({ kind: "missing", words, predicate: "", objects: [name], expected: true });
  }
  const binding = bindingOf(action);
  for (const condition of schema.definition.precons) {
    const [predicate, ...objects] = bound(condition, binding);
    const expected = condition.is_true;
    if (state.holds(predicate, ...objects) === expected) continue;
    const fact = state.task.describe([predicate, ...objects]);
    const words = `${expected ? "needs: " : "must not be: "}${fact}`;
    found.push({ kind: "condition", words, predicate, objects, expected });
  }
  return found;
}

/**
 * Return the facts that an action makes true and false at once.
 * @param {State} state @param {Action} action
 */
export function changes(state, action) {
  const binding = bindingOf(action);
  const results = action.schema.definition.immediate_fx;
  const atoms = (/** @type {boolean} */ wanted) =>
    results.filter((each) => each.is_true === wanted).map((each) => bound(each, binding));
  const names = new Set(atoms(true).map(atomName));
  return {
    added: atoms(true).filter((atom) => !state.holds(...atom)),
    removed: atoms(false).filter((atom) => state.holds(...atom) && !names.has(atomName(atom))),
  };
}
