/**
 * Meaning of clicks and keys, with a domain's input file.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./state.js").State} State
 * @typedef {import("./actions.js").Action} Action
 * @typedef {import("./near_misses.js").Binding} Binding
 * @typedef {import("./near_misses.js").Situation} Situation
 * @typedef {import("./floor.js").Tile} Tile
 * @typedef {{action: Action | null, hint: string, valid: boolean, advice: boolean}} Resolved
 *   Action that a click or key stands for, if any, and the action in words or the reason why it is
 *   not possible. An action that is not `valid` will be rejected. `advice` marks hints that say
 *   what to do instead.
 * @typedef {{key: string, action: Action}} Option Key, and the action it stands for now.
 */
import { bindingOf, changes, validActions } from "./actions.js";
import { labelsOf, Stepped } from "./effects.js";
import { readLanguage } from "./language.js";
import { NearMisses, situationOf, thingsUpon } from "./near_misses.js";
import { scene } from "./scene.js";
import { byText } from "./task.js";
import { capitalised, Wording } from "./words.js";
import { endsWork, usefulActions, workInProgress } from "./work.js";

/** Hint of the use key while work goes on by itself. */
export const WAIT = "wait until it is done, or click to take it";
const EARLY = "before it is done";
/** Weight of a tile to the side, compared with one ahead. */
const ASIDE = 2;

/**
 * Clicks and keys of one player.
 *
 * The input file's binding of a click or key comes first. If that action is not valid or changes
 * nothing, a click on the player's own station stands for a key's action there, and a key stands
 * for a click's action that makes sense.
 */
export class Controls {
  /**
   * @param {Task} task
   * @param {any} bindings Input file with a click or key for every action.
   * @param {any} language The `language` of the rendering file.
   */
  constructor(task, bindings, language) {
    this.task = task;
    this.language = readLanguage(language);
    /** @type {Map<string, string>} Names of the participants by player. */
    this.names = new Map();
    /** @type {Map<string, Binding[]>} */
    this._clicks = new Map();
    /** @type {Map<string, Binding[]>} */
    this._keys = new Map();
    for (const { name, input_instructions: how } of bindings.mouse_click_actions ?? []) {
      this._bind(this._clicks, how.button, name, how.click_on);
    }
    for (const { name, input_instructions: how } of bindings.keyboard_actions ?? []) {
      this._bind(this._keys, how.key.toLowerCase(), name, how.at ?? null);
    }
  }

  /**
   * @param {Map<string, Binding[]>} inputs @param {string} input @param {string} name
   * @param {string | null} parameter
   */
  _bind(inputs, input, name, parameter) {
    const schema = this.task.schemaOf.get(name);
    if (schema) inputs.set(input, [...(inputs.get(input) ?? []), { schema, parameter }]);
  }

  /** Keys of the input file, in its order. */
  get keys() {
    return [...this._keys.keys()];
  }

  /** Return whether the key's action depends on the player's station. @param {string} key */
  isForPlaces(key) {
    return (this._keys.get(key) ?? []).some(({ parameter }) => parameter);
  }

  /** Return the wording for the participant who plays a seat. @param {string | null} me */
  wording(me) {
    const others = [...this.names].filter(([player, name]) => player !== me && name);
    return new Wording(this.task, this.language, me, new Map(others));
  }

  /**
   * Resolve a click on an object or on one of the things on it.
   * @param {State} state @param {string} me @param {string} target @param {string} button
   */
  click(state, me, target, button = "left") {
    const situation = situationOf(state, me);
    const own = this._clicks.get(button) ?? [];
    // Players who click where they stand do not want to walk there.
    const others = own.length && target === situation.at ? this._keysAtAPlace() : [];
    const there = [target, ...thingsUpon(target, situation.placed)];
    // A key that is pressed once too often must do nothing else. A click has other actions.
    return this._resolve(situation, own, others, there, false);
  }

  /**
   * Resolve a key at the player's station.
   * @param {State} state @param {string} me @param {string} key
   */
  key(state, me, key) {
    const situation = situationOf(state, me), { at, placed } = situation;
    const own = this._keys.get(key.toLowerCase()) ?? [];
    const here = at ? [at, ...thingsUpon(at, placed)] : [];
    const atPlace = own.some(({ parameter }) => parameter) && here.length;
    const others = (atPlace && this._clicks.get("left")) || [];
    return this._sensible(state, me, this._resolve(situation, own, others, here));
  }

  _keysAtAPlace() {
    return [...this._keys.values()].flat().filter(({ parameter }) => parameter);
  }

  /**
   * Return what a key does: nothing if it would put an object where it is of no use. Players who
   * press a key at a stove want to cook, and at a crate to take something. A click puts objects
   * down anywhere.
   * @param {State} state @param {string} me @param {Resolved} resolved
   */
  _sensible(state, me, resolved) {
    const { action, valid } = resolved;
    const vain = valid && action ? this._vain(state, me, action) : "";
    return vain ? { ...nothing(vain), advice: true } : resolved;
  }

  /**
   * Return why a station is of no use for what an action puts there, or "".
   * @param {State} state @param {string} me @param {Action} action
   */
  _vain(state, me, action) {
    const { at, held, placed } = situationOf(state, me);
    if (labelsOf(action).length || at === null || !held.size) return "";
    const [wording, pile, [thing]] = [this.wording(me), thingsUpon(at, placed), thingsUpon(me, placed)];
    const kinds = new Set(pile.map((name) => state.kindOf(name)));
    const serves = state.kindOf(at) === this.task.problem.shift?.serve.station;
    const [misses, works] = [new NearMisses(wording), this._keysAtAPlace()];
    const workplace = works.some((each) => misses.isFor(each, at));
    if (pile.length && workplace) {
      // A second tomato on a board would only be in the way.
      const kind = state.kindOf(thing);
      const twice = kind === state.kindOf(pile[0]) &&
        !misses.leadsOn(action.schema, bindingOf(action), state);
      return twice ? `One ${wording.kind(kind)} at a time here` : "";
    }
    // A pile of one kind, as in a crate, is a supply and not a dish.
    const supply = pile.length > 1 && kinds.size === 1 && !serves && !this.task.floor.plain.has(at);
    const mixes = supply && !kinds.has(state.kindOf(thing));
    if (mixes) return `${capitalised(wording.thing(thing, state))} does not belong here`;
    if (pile.length || !workplace) return "";
    const after = state.changed(changes(state, action));
    const then = situationOf(after, me);
    const wanted = misses.leadsOn(action.schema, bindingOf(action), state, at);
    const here = [at, ...thingsUpon(at, then.placed)];
    // Work that was interrupted at this station goes on.
    const work = workInProgress(new Stepped(state, action));
    const resumes = work.some((row) => here.includes(row.subject) && row.arguments.includes(at));
    if (wanted || resumes || then.held.size || this.options(after, me).length) return "";
    const { advice, words } = misses.nearest(then, works, here, false);
    return advice ? words : `Nothing to do with ${wording.thing(thing, state)} here`;
  }

  /**
   * Return the keys whose own action at this station is valid and useful now.
   * @param {State} state @param {string} me @returns {Option[]}
   */
  options(state, me) {
    const situation = situationOf(state, me);
    const here = situation.at ? [situation.at] : [];
    return [...this._keys].flatMap(([key, bindings]) => {
      if (bindings.every(({ parameter }) => parameter === null)) return [];
      const action = useful(situation, bindings, here);
      return action ? [{ key, action }] : [];
    });
  }

  /** Return rows of (input, what it does), in the order of the input file. */
  help() {
    const wording = this.wording(null);
    const does = (/** @type {Binding[]} */ bindings) =>
      [...new Set(bindings.map(({ schema }) => wording.inGeneral(schema)))].join(", ");
    return [
      ...[...this._clicks].map(([button, own]) => [`${capitalised(button)} click`, does(own)]),
      ...[...this._keys].map(([key, own]) => [keyWords(key), does(own)]),
    ];
  }

  /**
   * Resolve direction keys that were pressed one after the other.
   * @param {State} state @param {string} me @param {Tile[]} directions @returns {Resolved}
   */
  walk(state, me, directions) {
    const busy = state.busySteps(me);
    if (busy) return nothing(busyWords(busy));
    const action = towards(state, me, directions);
    if (!action) return nothing("there is no free station that way");
    const hint = this.wording(me).action(action, state);
    return { action, hint, valid: true, advice: false };
  }

  /**
   * Resolve the use key: the most useful action here. That is a key's work here, or else what a
   * click on the station would do. Work that goes on by itself is not interrupted.
   * @param {State} state @param {string} me
   * @param {string} key Key that was pressed. Its binding in the input file comes first.
   * @returns {Resolved}
   */
  use(state, me, key = "") {
    const own = this._keys.has(key) ? this.key(state, me, key) : null;
    if (own?.valid) return own;
    const [option] = this.options(state, me);
    if (option) return this.key(state, me, option.key);
    const here = scene(state).get(me)?.at ?? null;
    if (here === null) return own ?? nothing("nothing to do here");
    const clicked = this.click(state, me, here);
    if (clicked.valid && clicked.action && endsWork(state, clicked.action)) return nothing(WAIT);
    return clicked.action || !own?.action ? this._sensible(state, me, clicked) : own;
  }

  /**
   * Return the player's useful actions, the most useful ones first: work, picking up and putting
   * down here; walks to stations with something on them; other walks, the nearest first; waiting.
   * @param {State} state @param {string} me
   */
  possible(state, me) {
    const placed = scene(state);
    const here = placed.get(me)?.at;
    const hosts = new Set([...placed.values()].map(({ host }) => host));
    const { floor } = this.task;
    const rank = (/** @type {Action} */ action) => {
      const there = action.destination;
      if (there !== null) {
        const matters = hosts.has(there) || !floor.plain.has(there);
        return [matters ? 3 : 4, here ? floor.distance(here, there) : 0];
      }
      if (isIdle(action)) return [5, 0];
      const { before, after } = carried(state, me, action);
      return [after.size > before.size ? 1 : after.size < before.size ? 2 : 0, 0];
    };
    const ranked = usefulActions(state, me).map((action) => ({ action, rank: rank(action) }));
    ranked.sort((a, b) => a.rank[0] - b.rank[0] || a.rank[1] - b.rank[1]);
    return ranked.map(({ action }) => action);
  }

  /**
   * Return rows of (key, what it does now), the most useful first. If nothing can be done here,
   * the row says what must happen first. Its key is empty if no key would submit an action.
   * @param {State} state @param {string} me
   * @param {string} useKey Label of the use key.
   * @returns {[string, string][]}
   */
  hints(state, me, useKey) {
    if (state.busySteps(me)) return [];
    const done = new Map(this.options(state, me).map(({ key, action }) => [action.key, key]));
    /** @type {[string, string][]} */
    const found = [...done.values()].map((key) => [keyWords(key), this.key(state, me, key).hint]);
    const resolved = this.use(state, me);
    const { action } = resolved;
    if (resolved.valid && action && !done.has(action.key)) found.push([useKey, resolved.hint]);
    if (!found.length && resolved.hint === WAIT) found.push([useKey, "Wait until it is done"]);
    if (!found.length && (action || resolved.advice)) {
      found.push([action ? useKey : "", resolved.hint]);
    }
    const here = scene(state).get(me)?.at;
    const clicked = here ? this.click(state, me, here) : resolved;
    if (clicked.valid && clicked.action?.key !== action?.key) {
      found.push(["Click", this.hintWords(clicked, state)]);
    }
    return found;
  }

  /**
   * Return an input's hint, with a warning if the action would interrupt work.
   * @param {Resolved} resolved @param {State} state
   */
  hintWords({ action, hint, valid }, state) {
    return valid && action && endsWork(state, action) ? `${hint} ${EARLY}` : hint;
  }

  /**
   * @param {Situation} situation @param {Binding[]} own @param {Binding[]} others
   * @param {string[]} candidates
   * @param {boolean} onlyOwnAtWork True if work that goes on here rules out the others.
   * @returns {Resolved}
   */
  _resolve(situation, own, others, candidates, onlyOwnAtWork = true) {
    if (!own.length) return nothing("");
    const { state, me } = situation, busy = state.busySteps(me);
    if (busy) return nothing(busyWords(busy));
    const wording = this.wording(me);
    let action = useful(situation, own, candidates);
    const atWork = !action && isAtWork(situation, own, candidates);
    if (!action && !(atWork && onlyOwnAtWork)) action = useful(situation, others, candidates);
    const hint = action ? capitalised(wording.action(action, state)) : "";
    if (action) return { action, hint, valid: true, advice: false };
    const bindings = [...own, ...others];
    const miss = new NearMisses(wording).nearest(situation, bindings, candidates, atWork);
    return { action: miss.action, hint: miss.words, valid: false, advice: miss.advice };
  }
}

/** Return a key's label, such as `E`, `Space` or `F11`. @param {string} key */
export function keyWords(key) {
  const short = key === "return" ? "Enter" : key === "escape" ? "Esc" : "";
  return short || (/^.\d+$/.test(key) ? key.toUpperCase() : capitalised(key));
}

/**
 * Return the things that an action puts into a player's hands or takes from them.
 * @param {State} state @param {string} me @param {Action} action
 */
export function handled(state, me, action) {
  const { before, after } = carried(state, me, action);
  return new Set([...before, ...after].filter((name) => before.has(name) !== after.has(name)));
}

/**
 * Return whether an action separates two things that may belong together in a dish.
 * @param {State} state @param {Action} action
 */
export function takesApart(state, action) {
  const { goal, problem, when } = state.task;
  const apart = changes(state, action).removed.filter(
    ([predicate]) => when.get(predicate) === "next_in_stack");
  const pairs = apart.map(([, ...names]) => names.map((name) => state.kindOf(name)));
  /** @type {{goal: import("./task.js").Term[]}[]} */
  const dishes = [{ goal }, ...Object.values(problem.shift?.menu ?? {})];
  return pairs.some(([one, other]) =>
    // Equal things are a supply.
    one !== other && dishes.some(({ goal: terms }) => {
      const kinds = terms.flatMap(({ args }) => args);
      return kinds.includes(one) && kinds.includes(other);
    }));
}

/** Return whether an action does nothing, such as waiting. @param {Action} action */
export function isIdle(action) {
  return !action.schema.definition.immediate_fx.length && !labelsOf(action).length;
}

/**
 * Return the things that a player carries before and after an action.
 * @param {State} state @param {string} me @param {Action} action
 */
function carried(state, me, action) {
  const rules = state.task.layout.filter(({ when }) => when === "shares_tile");
  const carries = new Set(rules.map(({ predicate }) => predicate));
  const { added, removed } = changes(state, action);
  const things = (/** @type {string[][]} */ atoms) =>
    atoms.flatMap(([predicate, ...names]) =>
      carries.has(predicate) && names.includes(me) ? names.filter((name) => name !== me) : []);
  const before = [...carries].flatMap((predicate) =>
    state.task.isStatic(predicate) ? [] : state.truths(predicate));
  const gone = new Set(removed.map(String));
  const after = [...before.filter((atom) => !gone.has(String(atom))), ...added];
  return { before: new Set(things(before)), after: new Set(things(after)) };
}

/**
 * Return the first valid and useful action of some bindings.
 * @param {Situation} situation @param {Binding[]} bindings @param {string[]} candidates
 */
function useful({ state, me }, bindings, candidates) {
  const valid = bindings.length ? usefulActions(state, me) : [];
  for (const binding of bindings) {
    const found = valid.find((action) => fits(action, binding, candidates));
    if (found) return found;
  }
  return null;
}

/**
 * Return whether the bindings' work is going on or done here.
 * @param {Situation} situation @param {Binding[]} bindings @param {string[]} candidates
 */
function isAtWork({ state, me }, bindings, candidates) {
  if (workInProgress(state).some(({ subject }) => candidates.includes(subject))) return true;
  const valid = validActions(state, me);
  return bindings.some((binding) => valid.some((action) => fits(action, binding, candidates)));
}

/** @param {Action} action @param {Binding} binding @param {string[]} candidates */
function fits(action, { schema, parameter }, candidates) {
  if (action.schema !== schema) return false;
  return parameter === null || candidates.includes(bindingOf(action).get(parameter) ?? "");
}

/**
 * Return the walk in some directions, one after the other, without stops on the way.
 *
 * The first direction is relative to the station where the player is, or else to the player's
 * tile, and each other direction to the station before it. A direction without a free station on
 * that side changes nothing.
 * @param {State} state @param {string} me @param {Tile[]} directions
 */
function towards(state, me, directions) {
  const placed = scene(state);
  const own = placed.get(me);
  let here = own?.at ? placed.get(own.at)?.tile : own?.tile;
  if (!here) return null;
  /** @type {Map<string, Action>} */
  const walks = new Map();
  for (const action of validActions(state, me)) {
    const there = action.destination;
    if (there !== null && !walks.has(there)) walks.set(there, action);
  }
  const reachable = new Set([...walks.keys(), ...(own?.at ? [own.at] : [])]);
  let target = own?.at ?? null;
  for (const direction of directions) {
    const found = nearest(here, direction, reachable, placed);
    if (found) [target, here] = [found.name, found.tile];
  }
  return (target && walks.get(target)) || null;
}

/**
 * Return the nearest of some stations in a direction. Stations that lie more to the side than
 * ahead come last: nobody expects that a key for walking to the right leads to the corner above.
 * @param {Tile} here @param {Tile} direction @param {Set<string>} names
 * @param {Map<string, import("./scene.js").Placed>} placed
 */
function nearest([x, y], [right, up], names, placed) {
  const ranked = [...names].flatMap((name) => {
    const tile = placed.get(name)?.tile;
    if (!tile) return [];
    const [dx, dy] = [tile[0] - x, tile[1] - y];
    const ahead = dx * right + dy * up;
    const aside = Math.abs(dx * up) + Math.abs(dy * right);
    return ahead > 0 ? [{ name, tile, off: aside > ahead, far: ahead + ASIDE * aside }] : [];
  });
  // Ties go to the first name, so that the same key always leads to the same station.
  ranked.sort((a, b) =>
    Number(a.off) - Number(b.off) || a.far - b.far || byText(a.name, b.name));
  return ranked[0] ?? null;
}

/** @param {string} hint @returns {Resolved} */
const nothing = (hint) => ({ action: null, hint, valid: false, advice: false });

/** @param {number} steps */
const busyWords = (steps) => `you are busy for ${steps} more step${steps > 1 ? "s" : ""}`;
