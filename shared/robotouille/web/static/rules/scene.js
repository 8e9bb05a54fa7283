/**
 * The place of every object in a state, by applying the domain's layout rules in reverse.
 * A port of `robotouille/world/scene.py`. No drawing and no time.
 */

import { append } from "./task.js";

/** @typedef {import("./task.js").Thing} Thing */
/** @typedef {import("./state.js").State} State */
/** @typedef {[number, number]} Tile */

/**
 * One object of a scene.
 * @typedef {object} Placed
 * @property {Thing} thing The object.
 * @property {Tile | null} tile Tile of the object or of its host.
 * @property {string | null} host The station, player or container that carries the object.
 * @property {number} level Number of objects below it in its stack.
 * @property {Tile | null} facing Unit vector of a player's direction.
 * @property {string | null} at The station where a player is.
 * @property {Set<string>} facts Unary predicates that hold of the object.
 * @property {string[]} contents Items that are related to the object and have no other place.
 */

/** @type {WeakMap<State, Map<string, Placed>>} */
const known = new WeakMap();

/**
 * Return every object of a state by name, with its place. Do not modify the result: it is cached.
 * @param {State} state @returns {Map<string, Placed>}
 */
export function scene(state) {
  const found = known.get(state) ?? placed(state);
  known.set(state, found);
  return found;
}

/** @param {State} state @returns {Map<string, Placed>} */
function placed(state) {
  const { task } = state;
  /** @type {Map<string, string>} */
  const at = new Map();
  /** @type {Map<string, string>} */
  const hosts = new Map();
  /** @type {Map<string, string>} */
  const below = new Map();
  /** @type {Map<string, Set<string>>} */
  const facts = new Map();
  /** @type {Map<string, string[]>} */
  const related = new Map();
  for (const atom of state.atoms()) {
    const [predicate, first, second] = atom;
    const rule = task.when.get(predicate);
    if (rule === "faces") at.set(first, second);
    else if (rule === "next_in_stack") below.set(first, second);
    else if (rule === "shares_tile") {
      // One of the two carries the other: a station or a player carries what is not.
      const type = state.objects.get(first)?.type ?? "";
      if (task.stationTypes.has(type) || task.playerTypes.has(type)) hosts.set(second, first);
      else hosts.set(first, second);
    } else if (atom.length === 2) {
      facts.set(first, (facts.get(first) ?? new Set()).add(predicate));
    } else if (rule !== "bottom_of_stack" && rule !== "reaches" && atom.length > 2) {
      append(related, atom[atom.length - 1], first);
    }
  }
  const standing = tilesOfPlayers(state, at);
  /** @type {Map<string, Placed>} */
  const found = new Map();
  for (const thing of state.objects.values()) {
    const { name } = thing;
    const tile = task.stationTypes.has(thing.type) ? thing.tile : (standing.get(name) ?? null);
    found.set(name, {
      thing,
      tile,
      host: hosts.get(name) ?? null,
      level: levelOf(name, below),
      facing: facingOf(state, thing, tile, at.get(name)),
      at: at.get(name) ?? null,
      facts: facts.get(name) ?? new Set(),
      contents: (related.get(name) ?? []).filter((other) => !hosts.has(other)),
    });
  }
  const own = new Map([...found].map(([name, each]) => [name, each.tile]));
  for (const each of found.values()) {
    let { host } = each;
    // The loop is bounded because custom domains can have cyclic relations.
    for (let i = 0; i < found.size && each.tile === null && host !== null; i += 1) {
      if (!own.has(host)) break;
      each.tile = own.get(host) ?? null;
      host = found.get(host)?.host ?? null;
    }
  }
  return found;
}

/** @param {string} name @param {Map<string, string>} below */
function levelOf(name, below) {
  // A custom domain can put objects on each other in a circle, so visited ones are tracked.
  const seen = new Set([name]);
  let next = below.get(name);
  while (next && !seen.has(next)) {
    seen.add(next);
    next = below.get(next);
  }
  return seen.size - 1;
}

/**
 * Return whether two tiles are the same.
 * @param {Tile | null | undefined} one @param {Tile | null | undefined} other
 */
export function sameTile(one, other) {
  return !!one && !!other && one[0] === other[0] && one[1] === other[1];
}

/**
 * Return each player's tile next to its station, different from others if possible.
 * @param {State} state @param {Map<string, string>} at
 */
function tilesOfPlayers(state, at) {
  const { task } = state;
  /** @type {Map<string, Tile>} */
  const taken = new Map();
  for (const name of task.players) {
    const thing = task.things.get(name);
    const station = at.get(name);
    if (thing === undefined) continue;
    /** @type {Tile[]} */
    let choices = station === undefined ? [] : task.floor.beside(station);
    if (thing.tile) {
      // A counter can be used from both sides, but the player is on one.
      const reached = task.floor.connected(thing.tile, choices);
      if (reached.length > 0) choices = reached;
      // A player that has not moved stays where the problem puts it.
      if (station === undefined || sameTile(task.things.get(station)?.tile, thing.facing)) {
        choices = [thing.tile, ...choices];
      }
    }
    const others = [...taken.values()];
    const free = choices.find((tile) => !others.some((other) => sameTile(tile, other)));
    const tile = free ?? choices[0];
    if (tile !== undefined) taken.set(name, tile);
  }
  return taken;
}

/**
 * @param {State} state @param {Thing} thing @param {Tile | null} tile
 * @param {string | undefined} station @returns {Tile | null}
 */
function facingOf(state, thing, tile, station) {
  if (!state.task.playerTypes.has(thing.type) || tile === null) return null;
  const there = station === undefined ? null : state.task.things.get(station)?.tile;
  if (!there || sameTile(there, tile)) return [0, -1];
  const [dx, dy] = [there[0] - tile[0], there[1] - tile[1]];
  // A custom domain can have a player at a distant station; it faces the longer way.
  if (Math.abs(dx) > Math.abs(dy)) return [dx > 0 ? 1 : -1, 0];
  return [0, dy > 0 ? 1 : -1];
}
