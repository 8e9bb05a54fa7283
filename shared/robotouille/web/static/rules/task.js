/**
 * A task: its objects and their numbered names, its action schemas, and the facts that never
 * change. The server has checked the task's files; this module only fills in their defaults.
 *
 * @typedef {import("./floor.js").Tile} Tile
 * @typedef {[string, ...string[]]} Atom A ground predicate: its name, then the names of its arguments.
 * @typedef {{predicate: string, params: string[], is_true: boolean}} Condition
 * @typedef {{
 *   type: string, param: string, conditions: Condition[], fx: Condition[], sfx: EffectDef[],
 *   created: {name: string, type: string, param: string} | null, config: string | null,
 *   default: number,
 * }} EffectDef
 * @typedef {{
 *   name: string, precons: Condition[], immediate_fx: Condition[], sfx: EffectDef[],
 *   language_description: string, travel: [string, string] | null,
 * }} ActionDef
 * @typedef {{
 *   name: string, kind: string, type: string, tile: Tile | null, facing: Tile | null,
 *   label: string | number | null,
 * }} Thing Object such as `lettuce1` of kind `lettuce`. `facing` is the tile before a player.
 * @typedef {{definition: EffectDef, variables: string[]}} EffectSchema
 * @typedef {{
 *   name: string, definition: ActionDef, parameters: [string, string][],
 *   player: boolean, effects: EffectSchema[], started: number,
 * }} Schema Action over typed parameters, the acting player first. The action itself starts the
 *   first `started` effects; the others start when one of these creates or deletes an object.
 * @typedef {{delayFactor: number, stepsPerTile: number, repeatSteps: number}} Profile
 * @typedef {{predicate: string, when?: string, unless?: string[]}} LayoutRule
 * @typedef {{predicate: string, args: string[], ids: (string | number)[]}} Term
 */
import { Floor } from "./floor.js";
import { fields } from "./language.js";

/** @type {Map<string, Profile>} */
const PROFILES = new Map([
  ["benchmark", { delayFactor: 1, stepsPerTile: 0, repeatSteps: 1 }],
  ["people", { delayFactor: 5, stepsPerTile: 1, repeatSteps: 2 }],
]);

/** Return an atom's name, such as `item_on(lettuce1, table2)`. @param {Atom} atom */
export const atomName = (atom) => `${atom[0]}(${atom.slice(1).join(", ")})`;

/**
 * Compare texts in the order of Python. Names have characters of the basic plane only.
 * @param {string} a @param {string} b
 */
export const byText = (a, b) => (a < b ? -1 : a > b ? 1 : 0);

/**
 * Return an object's own value of a key that comes from a file.
 * @param {any} object @param {string} key
 */
export const own = (object, key) =>
  object && Object.hasOwn(object, key) ? object[key] : undefined;

/**
 * Append a value to the list of a key.
 * @template K, V
 * @param {Map<K, V[]>} lists @param {K} key @param {V} value
 */
export function append(lists, key, value) {
  lists.get(key)?.push(value) ?? lists.set(key, [value]);
}

/**
 * Return the names that a condition's parameters stand for.
 * @param {Condition} condition @param {Map<string, string>} binding @returns {Atom}
 */
export function bound(condition, binding) {
  return [condition.predicate, ...condition.params.map((name) => binding.get(name) ?? "")];
}

/**
 * Yield special effects, nested ones included.
 * @param {EffectDef[]} effects @returns {Generator<EffectDef>}
 */
export function* nested(effects) {
  for (const effect of effects) {
    yield effect;
    yield* nested(effect.sfx);
  }
}

export class Task {
  /** @param {any} raw The `task` of a snapshot. */
  constructor(raw) {
    const { domain, problem } = raw;
    /** @type {string} */
    this.name = raw.name;
    this.domain = domain;
    this.problem = problem;
    /** @type {number} */
    this.seats = raw.seats;
    this.profile = PROFILES.get(raw.timing) ?? /** @type {Profile} */ (PROFILES.get("benchmark"));
    /** @type {string[]} */
    this.types = domain.object_types;
    this.stationTypes = new Set(domain.station_types ?? ["station"]);
    this.playerTypes = new Set(domain.player_types ?? ["player"]);
    /** @type {LayoutRule[]} */
    this.layout = domain.layout ?? [];
    /** What a fact says about places, by predicate. */
    this.when = new Map(this.layout.flatMap(({ predicate, when }) =>
      when ? [/** @type {const} */ ([predicate, when])] : []));
    /** @type {Term[]} */
    this.goal = problem.goal ?? [];
    /** @type {any[]} */
    const defs = domain.predicate_defs;
    /** @type {Map<string, string[]>} Types of the arguments by predicate. */
    this.predicates = new Map(defs.map((each) => [each.name, each.param_types]));
    /** @type {Map<string, any>} */
    this._descriptors = new Map(defs.map((each) => [each.name, each.language_descriptors ?? {}]));
    /** @type {Map<string, Thing>} The objects of the problem. Play can create further ones. */
    this.things = new Map(placed(this).map((thing) => [thing.name, thing]));
    const all = [...this.things.values()];
    this.players = all.filter((each) => this.playerTypes.has(each.type)).map(({ name }) => name);
    /** @type {Schema[]} */
    this.schemas = domain.action_defs.map((/** @type {any} */ each) => schemaOf(each, this));
    /** @type {Map<string, Schema>} */
    this.schemaOf = new Map(this.schemas.map((each) => [each.name, each]));
    /** Types of objects that play can create or delete. */
    this.transient = transientTypes(this.schemas);
    this.floor = new Floor(problem.width, problem.height, all, this.stationTypes);
    /** Predicates that some action can change. */
    this.fluents = fluents(this.schemas);
    /** @type {Map<string, Atom[]>} Atoms that never change, by predicate. */
    this.statics = new Map();
    /** @type {Map<string, Atom>} Atoms that never change, by name. */
    this.staticNames = new Map();
    for (const atom of initialFacts(this, all)) {
      if (this.fluents.has(atom[0]) || this.staticNames.has(atomName(atom))) continue;
      this.staticNames.set(atomName(atom), atom);
      append(this.statics, atom[0], atom);
    }
  }

  /** Return whether no action can change a predicate. @param {string} predicate */
  isStatic(predicate) {
    return this.predicates.has(predicate) && !this.fluents.has(predicate);
  }

  /** Return a fact as a sentence, such as `lettuce1 is cut`. @param {Atom} atom */
  describe(atom) {
    const descriptors = this._descriptors.get(atom[0]) ?? {};
    const [first] = Object.keys(descriptors);
    const sentence = own(descriptors, "0") || (first === undefined ? "" : descriptors[first]);
    return sentence
      ? sentence.replace(/\{(\d+)\}/g, (/** @type {string} */ whole, /** @type {string} */ n) =>
          atom[Number(n) + 1] ?? whole)
      : atomName(atom);
  }
}

/**
 * Return all objects of a task, by type in the domain's order, then in the order of names.
 * @param {Task} task @returns {Thing[]}
 */
function placed(task) {
  // The published simulator ignores stack levels: on one tile, it numbers in the file's order.
  const published = (task.problem.version ?? "1.0.0").startsWith("1.");
  return task.types.flatMap((type) => {
    let definitions = [...(own(task.problem.objects, type) ?? [])];
    if (task.playerTypes.has(type)) definitions = definitions.slice(0, task.seats);
    definitions.sort((a, b) => a.x - b.x || a.y - b.y || (published ? 0 : level(a) - level(b)));
    /** @type {Map<string, number>} */
    const numbers = new Map();
    return definitions.map((each) => {
      const number = (numbers.get(each.name) ?? 0) + 1;
      numbers.set(each.name, number);
      const { name: kind, x, y, direction, predicates } = each;
      return {
        name: `${kind}${number}`,
        kind,
        type,
        tile: /** @type {Tile} */ ([x, y]),
        facing: direction ? /** @type {Tile} */ ([x + direction[0], y + direction[1]]) : null,
        label: each.id ?? null,
        level: level(each),
        predicates: predicates ?? [],
      };
    });
  });
}

/** @param {any} definition */
const level = (definition) => definition["stack-level"] ?? 0;

// Facts that follow from positions

/**
 * Yield the initial facts: kinds, the problem's predicates, and what positions imply.
 * @param {Task} task @param {any[]} things
 */
function initialFacts(task, things) {
  /** @type {Atom[]} */
  const facts = [];
  const types = (/** @type {string} */ predicate) => task.predicates.get(predicate) ?? [];
  for (const { name, kind, type, predicates } of things) {
    const [first, ...others] = types(`is${kind}`);
    if (first === type && !others.length) facts.push([`is${kind}`, name]);
    for (const predicate of predicates) facts.push([predicate, name]);
  }
  for (const { predicate, when } of task.layout) {
    const [one, two] = types(predicate);
    if (when === "reaches") {
      const players = things.filter((each) => each.type === one && each.facing);
      for (const player of players) {
        for (const station of task.floor.stations.keys()) {
          const { floor } = task;
          if (floor.connected(player.tile, floor.beside(station)).length) {
            facts.push([predicate, player.name, station]);
          }
        }
      }
    } else if (when === "shares_tile" || when === "faces") {
      for (const first of things.filter((each) => each.type === one)) {
        const tile = (when === "faces" && first.facing) || first.tile;
        for (const second of things) {
          if (second.type !== two || second === first || !same(second.tile, tile)) continue;
          facts.push([predicate, first.name, second.name]);
        }
      }
    } else if (when) {
      facts.push(...stackFacts(task, predicate, when, things.filter((each) => each.type === one)));
    }
  }
  // `unless` rules come last because they depend on the other facts.
  for (const { predicate, unless } of task.layout) {
    if (!unless) continue;
    const [type] = types(predicate);
    const taken = new Set();
    for (const [other, ...names] of facts) {
      if (!unless.includes(other)) continue;
      names.forEach((name, i) => types(other)[i] === type && taken.add(name));
    }
    for (const { name } of things.filter((each) => each.type === type && !taken.has(each.name))) {
      facts.push([predicate, name]);
    }
  }
  return facts;
}

/**
 * Yield the facts about stacks of objects on stations.
 * @param {Task} task @param {string} predicate @param {string} when @param {any[]} things
 * @returns {Generator<Atom>}
 */
function* stackFacts(task, predicate, when, things) {
  for (const [station, tile] of task.floor.stations) {
    const stack = things.filter((each) => same(each.tile, tile)).sort((a, b) => a.level - b.level);
    if (!stack.length) continue;
    if (when === "bottom_of_stack") yield [predicate, stack[0].name, station];
    else if (when === "top_of_stack") yield [predicate, stack[stack.length - 1].name];
    else for (let i = 1; i < stack.length; i++) yield [predicate, stack[i].name, stack[i - 1].name];
  }
}

/** @param {Tile} a @param {Tile} b */
const same = (a, b) => a[0] === b[0] && a[1] === b[1];

// Action schemas

/** @param {any} raw @param {Task} task @returns {Schema} */
function schemaOf(raw, task) {
  /** @type {ActionDef} */
  const definition = {
    name: raw.name,
    precons: conditions(raw.precons),
    immediate_fx: conditions(raw.immediate_fx),
    sfx: (raw.sfx ?? []).map(effectDef),
    language_description: raw.language_description,
    travel: raw.travel ?? null,
  };
  const types = parameterTypes(definition, task);
  const actor = [...types.keys()].find((name) => task.playerTypes.has(types.get(name)));
  const mentioned = fields(definition.language_description).filter((name) => types.has(name));
  const order = new Set([...(actor === undefined ? [] : [actor]), ...mentioned, ...types.keys()]);
  // Effects nested in an instant effect start separately, so they need numbers of their own.
  const born = [...nested(definition.sfx)].filter(isInstant).flatMap((effect) => effect.sfx);
  return {
    name: raw.name,
    definition,
    parameters: [...order].map((name) => [name, /** @type {string} */ (types.get(name))]),
    player: actor !== undefined,
    effects: [...definition.sfx, ...born].map((each) => ({
      definition: each,
      variables: variables(each),
    })),
    started: definition.sfx.length,
  };
}

/** @param {any[] | undefined} raw @returns {Condition[]} */
const conditions = (raw) => (raw ?? []).map((each) => ({ is_true: true, ...each }));

/** @param {any} raw @returns {EffectDef} */
function effectDef(raw) {
  return {
    type: raw.type,
    param: raw.param,
    conditions: conditions(raw.conditions),
    fx: conditions(raw.fx),
    sfx: (raw.sfx ?? []).map(effectDef),
    created: raw.created_obj ?? null,
    config: raw.config ?? null,
    default: raw.default ?? 3,
  };
}

/**
 * Return whether an effect completes in the step in which it starts.
 * @param {{type: string}} effect
 */
export const isInstant = ({ type }) => type === "creation" || type === "deletion";

/**
 * Return an action's parameters in order of first mention, with their types.
 * @param {ActionDef} action @param {Task} task
 */
function parameterTypes(action, task) {
  /** @type {Map<string, string>} */
  const types = new Map();
  const effects = [...nested(action.sfx)];
  const later = effects.flatMap((effect) => [...effect.conditions, ...effect.fx]);
  for (const { predicate, params } of [...action.precons, ...action.immediate_fx, ...later]) {
    const kinds = task.predicates.get(predicate) ?? [];
    params.forEach((name, i) => i < kinds.length && !types.has(name) && types.set(name, kinds[i]));
  }
  // A created object is chosen by the simulator, not by the acting player.
  for (const { created } of effects) if (created) types.delete(created.param);
  return types;
}

/**
 * Return the parameters that an effect mentions, without those of objects that it creates.
 * @param {EffectDef} definition
 */
function variables(definition) {
  const effects = [...nested([definition])];
  const created = new Set(effects.map((each) => each.created?.param));
  const all = effects.flatMap(({ param, conditions, fx }) => [
    param,
    ...[...conditions, ...fx].flatMap(({ params }) => params),
  ]);
  return [...new Set(all)].filter((name) => !created.has(name));
}

/** @param {Schema[]} schemas */
function transientTypes(schemas) {
  const found = new Set();
  for (const { definition, parameters } of schemas) {
    const types = new Map(parameters);
    for (const effect of nested(definition.sfx)) {
      if (effect.created) found.add(effect.created.type);
      const type = effect.type === "deletion" ? types.get(effect.param) : undefined;
      if (type !== undefined) found.add(type);
    }
  }
  return found;
}

/** @param {Schema[]} schemas @returns {Set<string>} */
function fluents(schemas) {
  const results = schemas.flatMap(({ definition }) => [
    ...definition.immediate_fx,
    ...[...nested(definition.sfx)].flatMap(({ fx }) => fx),
  ]);
  return new Set(results.map(({ predicate }) => predicate));
}
