/**
 * Dishes on a station for serving that no open order takes, and what is wrong with them.
 * A port of `robotouille/world/presentation/unserved.py`.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Term} Term
 * @typedef {import("./state.js").State} State
 * @typedef {import("./words.js").Wording} Wording
 * @typedef {{station: string, things: string[], dish: string, fault: string}} Unserved Dish that
 *   looks ready. The fault is empty if the dish is ready, but nobody has ordered it.
 * @typedef {{
 *   dish: string, goal: Goal, failing: Term[], chosen: Map<string | number, string>,
 *   surplus: string[],
 * }} Misfit Difference between some things and a dish: terms that fail, and things too many.
 */
import { Goal } from "./goal.js";
import { scene } from "./scene.js";
import { byText } from "./task.js";

/**
 * Return the dishes of a shift that look ready but are not served.
 * @param {State} state @param {Wording} wording @returns {Unserved[]}
 */
export function unserved(state, wording) {
  const { shift } = state.task.problem;
  const { orders, task } = state;
  if (!shift || !orders || orders.time >= shift.steps * task.profile.delayFactor) return [];
  const counters = [...task.floor.stations.keys()].filter(
    (name) => state.kindOf(name) === shift.serve.station);
  return counters.flatMap((station) => {
    const things = thingsOn(station, state);
    const found = things.size ? on(station, things, state, wording) : null;
    return found ?? [];
  });
}

/**
 * @param {string} station @param {Set<string>} things @param {State} state
 * @param {Wording} wording @returns {Unserved | null}
 */
function on(station, things, state, wording) {
  const { menu, arrivals } = state.task.problem.shift;
  const alone = onlyAbout(things, state);
  const fitted = (/** @type {string} */ dish) => misfit(dish, new Goal(state.task, menu[dish].goal), things, alone);
  const row = (/** @type {string} */ dish, fault = "") =>
    ({ station, things: [...things].sort(byText), dish, fault });
  const made = Object.keys(menu).find((dish) => {
    const { goal, failing, surplus } = fitted(dish);
    return things.size === parts(goal, state) && !failing.length && !surplus.length;
  });
  if (made !== undefined) return row(made);
  const open = [.../** @type {import("./state.js").Orders} */ (state.orders).open];
  open.sort((a, b) => a.due - b.due || a.number - b.number);
  const wanted = new Set(open.map(({ number }) => arrivals[number].dish));
  const misfits = [...wanted].map(fitted);
  const size = (/** @type {Misfit} */ { failing, surplus }) => failing.length + surplus.length;
  const least = Math.min(...misfits.map(size));
  const nearest = misfits.find((each) => size(each) === least);
  if (!nearest || !looksReady(nearest, things, state)) return null;
  return row(nearest.dish, fault(nearest, station, state, wording));
}

/** Return whether objects of a type can be served. @param {Task} task @param {string} type */
const moves = (task, type) => !task.stationTypes.has(type) && !task.playerTypes.has(type);

/** @param {State} state @param {string} name */
const isMovable = ({ task, table }, name) => moves(task, table.things.get(name)?.type ?? "");

/** Return all things on a station that serves. @param {string} station @param {State} state */
function thingsOn(station, state) {
  /** @type {string[]} */
  const predicates = state.task.problem.shift.serve.predicates;
  const found = new Set(predicates.flatMap((each) =>
    state.truths(each).filter((atom) => atom[2] === station).map((atom) => atom[1])));
  // The loop also visits what it adds.
  for (const name of found) {
    for (const [, ...names] of state.atoms()) {
      if (!names.includes(name)) continue;
      for (const other of names) if (isMovable(state, other)) found.add(other);
    }
  }
  return found;
}

/**
 * Return the state without the facts about other things that can move.
 * @param {Set<string>} things @param {State} state
 */
function onlyAbout(things, state) {
  const removed = state.table.atoms.filter(([, ...names]) =>
    names.some((name) => isMovable(state, name) && !things.has(name)));
  return state.changed({ added: [], removed });
}

/** Return the number of things that a dish consists of. @param {Goal} goal @param {State} state */
function parts(goal, { task, table }) {
  const all = [...table.things.values()];
  const typeOf = (/** @type {string | number} */ id, /** @type {string} */ kind) => {
    if (task.types.includes(kind)) return kind;
    return all.find((each) => each.label === id || each.kind === kind)?.type ?? kind;
  };
  return [...goal.kinds].filter(([id, kind]) => moves(task, typeOf(id, kind))).length;
}

/**
 * @param {string} dish @param {Goal} goal @param {Set<string>} things @param {State} alone
 * @returns {Misfit}
 */
function misfit(dish, goal, things, alone) {
  const { holding, chosen } = goal.fit(alone);
  const failing = goal.terms.filter((_, number) => !holding[number]);
  // Places come first: whoever forgot an ingredient need not read that it has to be cut.
  failing.sort((a, b) => Number(a.ids.length < 2) - Number(b.ids.length < 2));
  const used = new Set(chosen.values());
  const surplus = [...things].filter((name) => !used.has(name)).sort(byText);
  return { dish, goal, failing, chosen, surplus };
}

/**
 * Return whether players who see the things would expect them to be served.
 * @param {Misfit} misfit @param {Set<string>} things @param {State} state
 */
function looksReady({ goal, surplus }, things, state) {
  if (surplus.length === things.size) return false;
  if (things.size >= parts(goal, state)) return true;
  const placed = [...scene(state)].filter(([name]) => things.has(name)).map(([, each]) => each);
  // A container that has been filled.
  if (placed.some(({ host }) => host !== null && things.has(host))) return true;
  const highest = Math.max(...placed.map(({ level }) => level));
  const top = placed.find(({ level }) => level === highest)?.thing.kind ?? "";
  const needed = [...goal.kinds.values()].filter((kind) => kind === top).length;
  const there = placed.filter(({ thing }) => thing.kind === top).length;
  return tops(goal, state.task).has(top) && there >= needed;
}

/**
 * Return the kinds of the things that are the uppermost ones of a dish's stacks.
 * @param {Goal} goal @param {Task} task
 */
function tops({ terms, kinds }, task) {
  const pairs = terms.filter(({ predicate }) => task.when.get(predicate) === "next_in_stack");
  const covered = new Set(pairs.map(({ ids }) => ids[1]));
  const above = pairs.map(({ ids }) => ids[0]).filter((id) => !covered.has(id));
  return new Set(above.map((id) => kinds.get(id) ?? ""));
}

/**
 * @param {Misfit} misfit @param {string} station @param {State} state @param {Wording} wording
 */
function fault({ goal, failing, chosen: known, surplus }, station, state, wording) {
  if (!failing.length) return `${wording.thing(surplus[0], state)} does not belong to it`;
  const [term] = failing;
  const chosen = new Map(known);
  for (const id of term.ids) {
    if (chosen.has(id)) continue;
    const taken = new Set(chosen.values());
    const free = goal.candidates(id, state).filter((name) => !taken.has(name));
    const unmade = wording.kind(goal.kinds.get(id) ?? "");
    chosen.set(id, free.find((name) => name === station) ?? free[0] ?? unmade);
  }
  const objects = term.ids.map((id) => chosen.get(id) ?? "");
  const words = state.task.describe([term.predicate, ...objects]);
  const { predicate } = term;
  return wording.reason({ kind: "condition", predicate, objects, expected: true, words }, state);
}
