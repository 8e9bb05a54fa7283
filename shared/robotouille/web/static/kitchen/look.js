/**
 * Choice of a picture for each object of a state, and the order of objects in piles.
 * A port of `window/pictures/appearance.py` and of the parts of rendering files that it needs.
 */

import { scene } from "../rules/scene.js";
import { append } from "../rules/task.js";

/** @typedef {import("../rules/task.js").Task} Task */
/** @typedef {import("../rules/task.js").Thing} Thing */
/** @typedef {import("../rules/state.js").State} State */
/** @typedef {import("../rules/scene.js").Placed} Placed */
/** @typedef {"station" | "item" | "container" | "player"} Role */
/** @typedef {"front" | "back" | "left" | "right"} Side */
/** @typedef {Map<string, string[][]>} Related */
/** @typedef {Map<string, Map<string, number>>} Doing */

/**
 * Look of one object: a picture, or a generated tile with its kind and `words`.
 * @typedef {object} Appearance
 * @property {string} kind
 * @property {Role} role
 * @property {string | null} asset
 * @property {string} words
 * @property {string} facing
 * @property {string[]} effects The rendering's particle effects for this look.
 */

/**
 * One object of a pile. `contents` were added to it or to the objects in it.
 * @typedef {object} SpritePiece
 * @property {string} name
 * @property {Appearance} appearance
 * @property {number} scale
 * @property {number} rise Height above the pile's base, in tiles.
 * @property {Appearance[]} contents
 */

/**
 * Everything to draw of a state.
 * @typedef {object} SceneSprites
 * @property {Map<string, Placed>} placed
 * @property {Map<string, Appearance>} stations
 * @property {Map<string, SpritePiece[]>} piles Objects by host, from the bottom up.
 * @property {Map<string, number>} bases Height of each pile's base above the middle of its tile.
 */

/**
 * Picture with the conditions under which it is chosen, or a group of pictures by name.
 * @typedef {object} Art
 * @property {string | null} asset
 * @property {{name: string, params: string[]}[]} predicates
 * @property {string[]} during
 * @property {string[]} stages
 * @property {string[]} effects
 * @property {Map<string, Art>} named
 */

/** @typedef {{assets: Art, constants: Map<string, number>}} Entity */
/** @typedef {{constants: Map<string, number>, entities: Map<string, Entity>}} Group */

/** @type {Record<Role, number>} */
const SCALES = { station: 1.0, item: 0.62, container: 0.78, player: 1.0 };
const OFFSET = 0.16;
const HEIGHT = 0.1;
const ART_FIELDS = new Set(["asset", "predicates", "during", "stages", "effects", "tile"]);
/** Nesting of groups of pictures up to which a rendering is read. */
const MAX_DEPTH = 8;

/** @param {any} raw @param {number} depth @returns {Art} */
function readArt(raw, depth = 0) {
  const fields = typeof raw === "string" ? { asset: raw } : (raw ?? {});
  /** @type {Map<string, Art>} */
  const named = new Map();
  for (const [name, value] of Object.entries(fields)) {
    if (!ART_FIELDS.has(name) && value && depth < MAX_DEPTH) {
      named.set(name, readArt(value, depth + 1));
    }
  }
  return {
    asset: fields.asset ?? null,
    predicates: (fields.predicates ?? []).map((/** @type {any} */ each) => ({
      name: typeof each === "string" ? each : each.name,
      params: typeof each === "string" ? [] : (each.params ?? []),
    })),
    during: fields.during ?? [],
    stages: fields.stages ?? [],
    effects: fields.effects ?? [],
    named,
  };
}

/** @param {any} raw */
function readConstants(raw) {
  /** @type {Map<string, number>} */
  const found = new Map();
  for (const [name, value] of Object.entries(raw ?? {})) {
    if (typeof value === "number") found.set(name.toUpperCase(), value);
  }
  return found;
}

/** @param {any} raw @returns {Group} */
function readGroup(raw) {
  /** @type {Map<string, Entity>} */
  const entities = new Map();
  for (const [kind, each] of Object.entries(raw?.entities ?? {})) {
    const { assets, constants } = /** @type {any} */ (each);
    entities.set(kind, { assets: readArt(assets), constants: readConstants(constants) });
  }
  return { constants: readConstants(raw?.constants), entities };
}

/** @param {Art} art @returns {Generator<Art>} */
function* parts(art) {
  yield art;
  for (const each of art.named.values()) yield* parts(each);
}

/**
 * Return the member of a group, or the picture itself, whose conditions hold and are most.
 * @param {Art} art @param {Set<string>} own @param {string[][]} related
 * @param {Map<string, number>} doing
 */
function chosen(art, own, related, doing) {
  let best = art;
  let most = -1;
  for (const each of art.named.values()) {
    const count = each.predicates.length + (each.during.length > 0 ? 1 : 0);
    if (each.asset === null || count <= most) continue;
    if (each.during.length > 0 && !each.during.some((action) => doing.has(action))) continue;
    if (each.predicates.every((trait) => traitHolds(trait, own, related))) {
      best = each;
      most = count;
    }
  }
  return best;
}

/**
 * @param {{name: string, params: string[]}} trait @param {Set<string>} own
 * @param {string[][]} related
 */
function traitHolds({ name, params }, own, related) {
  if (params.length === 0) return own.has(name);
  return related.some(
    (fact) =>
      fact[0] === name &&
      fact.length === params.length + 1 &&
      params.every((kind, i) => kind === "" || kind === fact[i + 1]),
  );
}

/**
 * Return the picture to show during actions, given the share of each that is done.
 * @param {Art} art @param {Map<string, number>} doing
 */
function stageOf(art, doing) {
  const { stages } = art;
  if (stages.length === 0) return art.asset;
  const shares = art.during.flatMap((action) => doing.get(action) ?? []);
  const share = shares.length > 0 ? Math.max(...shares) : 0;
  const number = Math.min(Math.ceil(share * stages.length), stages.length) - 1;
  return stages[Math.max(0, number)];
}

/** @type {Map<string, number>} */
const NOTHING = new Map();

/** A rendering's pictures, chosen for the objects of a domain. */
export class Look {
  /**
   * @param {object} options
   * @param {any} options.rendering The merged rendering file.
   * @param {any} options.bindings The complete input file.
   * @param {Map<string, string>} options.pictures SVG texts or data URLs by file name.
   */
  constructor({ rendering, bindings, pictures }) {
    this.rendering = rendering;
    this.bindings = bindings;
    this.pictures = pictures;
    /** @type {Record<"item" | "station" | "container", Group>} */
    this.groups = {
      item: readGroup(rendering.item),
      station: readGroup(rendering.station),
      container: readGroup(rendering.container),
    };
    /** @type {Map<string, any>} */
    this.effects = new Map(Object.entries(rendering.effects ?? {}));
    /** @type {Map<string, string>} */
    this.during = new Map(Object.entries(rendering.during ?? {}));
    /** @type {Map<string, string>} */
    this.moments = new Map(Object.entries(rendering.moments ?? {}));
    /** @type {Map<string, any>} */
    this.tools = new Map(Object.entries(rendering.tools ?? {}));
    /** @type {Map<string, string>} */
    this.progress = new Map(Object.entries(rendering.progress ?? {}));
    /** @type {Map<string, string>} */
    this.icons = new Map(Object.entries(rendering.icons ?? {}));
    /** @type {Map<string, any[]>} */
    this.players = new Map();
    for (const [kind, looks] of Object.entries(rendering.player ?? {})) {
      this.players.set(kind, Array.isArray(looks) ? looks : [looks]);
    }
    /** @type {Map<string, any[]>} */
    this.names = new Map();
    for (const [kind, raw] of Object.entries(rendering.language?.kinds ?? {})) {
      const names = Array.isArray(raw) ? raw : [raw];
      this.names.set(kind, names.map((each) => (typeof each === "string" ? { name: each } : each)));
    }
    /** @type {Set<string>} */
    this.pictured = new Set();
    for (const { entities } of Object.values(this.groups)) {
      for (const { assets } of entities.values()) {
        for (const art of parts(assets)) {
          for (const trait of art.predicates) this.pictured.add(trait.name);
        }
      }
    }
    /** @type {WeakMap<Task, Map<string, string>>} */
    this.states = new WeakMap();
    /** @type {WeakMap<State, SceneSprites>} */
    this.stages = new WeakMap();
    /** @type {Task | null} */
    this.task = null;
  }

  /** Return everything to draw of a state, computed once. @param {State} state */
  stage(state) {
    this.task = state.task;
    const known = this.stages.get(state);
    if (known) return known;
    const stage = this.newStage(state);
    this.stages.set(state, stage);
    return stage;
  }

  /** @param {State} state @returns {SceneSprites} */
  newStage(state) {
    const { task } = state;
    const placed = scene(state);
    const related = relations(state);
    const doing = underWay(state);
    /** @type {Map<string, Appearance>} */
    const stations = new Map();
    /** @type {Map<string, Placed[]>} */
    const hosted = new Map();
    const inside = insides(placed);
    for (const [name, each] of placed) {
      const { type } = each.thing;
      const host = each.host === null ? undefined : placed.get(each.host);
      if (task.stationTypes.has(type)) {
        stations.set(name, this.appearance(each, inside, related, doing));
      } else if (host && !isHolder(task, host.thing.type)) {
        // The picture of a container shows what is in it.
        continue;
      } else if (each.host !== null) append(hosted, each.host, each);
      // An object on the bare floor is a pile of its own.
      else if (each.tile !== null && !task.playerTypes.has(type)) append(hosted, name, each);
    }
    /** @type {Map<string, SpritePiece[]>} */
    const piles = new Map();
    /** @type {Map<string, number>} */
    const bases = new Map();
    for (const [host, things] of hosted) {
      things.sort((one, other) => one.level - other.level);
      piles.set(host, this.pile(things, placed, inside, related, doing));
      bases.set(host, this.constant(things[0].thing, "STATION_OFFSET", OFFSET));
    }
    return { placed, stations, piles, bases };
  }

  /**
   * Return the look of an object other than a player.
   * @param {Placed} each
   * @param {Map<string, Placed[]>} inside Objects in each container.
   * @param {Related} related @param {Doing} doing @returns {Appearance}
   */
  appearance({ thing, facts }, inside, related, doing = new Map()) {
    const entity = this.entity(thing.kind);
    /** @type {string | null} */
    let asset = null;
    /** @type {string[]} */
    let effects = [];
    if (entity) {
      let art = entity.assets;
      let about = related.get(thing.name) ?? [];
      // A container may have pictures of its own for what is inside, such as a pot of soup.
      for (const meal of inside.get(thing.name) ?? []) {
        const group = art.named.get(meal.thing.kind);
        if (group && group.asset === null) {
          art = group;
          about = related.get(meal.thing.name) ?? [];
          break;
        }
      }
      const going = doing.get(thing.name) ?? NOTHING;
      const shown = chosen(art, facts, about, going);
      asset = stageOf(shown, going);
      effects = shown.effects;
    }
    const states = [...this.statesOfThings()].filter(([fact]) => facts.has(fact));
    const words = asset ? "" : states.map(([, word]) => word).sort().join(" ");
    return { kind: thing.kind, role: this.role(thing), asset, words, facing: "front", effects };
  }

  /**
   * Return the look of a station, a player or an object that is visible by itself.
   * @param {SceneSprites} stage @param {string} name @returns {Appearance | null}
   */
  shown(stage, name) {
    const station = stage.stations.get(name);
    if (station) return station;
    for (const pile of stage.piles.values()) {
      for (const piece of pile) if (piece.name === name) return piece.appearance;
    }
    const number = this.task?.players.indexOf(name) ?? -1;
    const kind = stage.placed.get(name)?.thing.kind;
    return number < 0 || kind === undefined ? null : this.player(kind, number, "front");
  }

  /**
   * Return what people call a kind and its state, such as `toasted bottom bun`.
   * @param {string} kind @param {Iterable<string>} facts
   */
  words(kind, facts) {
    const all = new Set(facts);
    const states = this.statesOfThings();
    const shows = this.shows(kind);
    const found = [...all].flatMap((fact) =>
      !shows || this.pictured.has(fact) ? (states.get(fact) ?? []) : [],
    );
    const names = this.names.get(kind) ?? [];
    const name = names.find((each) => !each.when || all.has(each.when))?.name ?? kind;
    return [...found.sort(), name].join(" ");
  }

  /** @param {string} kind */
  shows(kind) {
    if (this.players.has(kind) || this.groupOf(kind)) return true;
    return [...this.groups.container.entities.values()].some((e) => e.assets.named.has(kind));
  }

  /**
   * Return the look of the player in a seat from one side.
   * @param {string} kind @param {number} index @param {Side} facing @returns {Appearance}
   */
  player(kind, index, facing, carrying = false) {
    const facings = this.facings(kind, index);
    const sides = (carrying && facings?.carrying) || facings;
    const asset = sides?.[facing] ?? null;
    return { kind, role: "player", asset, words: "", facing, effects: [] };
  }

  /**
   * Return the look of a player with raised arms, or else from the front.
   * @param {string} kind @param {number} index
   */
  cheering(kind, index) {
    const asset = this.facings(kind, index)?.cheering;
    const plain = this.player(kind, index, "front", true);
    return asset ? { ...plain, asset } : plain;
  }

  /**
   * Return the picture of a player's shut eyes from one side, or null.
   * @param {string} kind @param {number} index @param {Side} facing @returns {string | null}
   */
  shutEyes(kind, index, facing) {
    return facing === "back" ? null : (this.facings(kind, index)?.shut?.[facing] ?? null);
  }

  /**
   * Return the pictures of a player's stride from one side.
   * @param {string} kind @param {number} index @param {Side} facing @returns {string[]}
   */
  feet(kind, index, facing) {
    const frames = this.facings(kind, index)?.feet?.[facing] ?? [];
    return typeof frames === "string" ? [frames] : frames;
  }

  /** @param {string} kind @param {number} index */
  facings(kind, index) {
    const choices = this.players.get(kind) ?? this.players.values().next().value;
    return choices && choices.length > 0 ? choices[index % choices.length] : null;
  }

  /**
   * @param {Placed[]} things @param {Map<string, Placed>} placed
   * @param {Map<string, Placed[]>} inside @param {Related} related @param {Doing} doing
   */
  pile(things, placed, inside, related, doing) {
    let rise = 0;
    return things.map((each) => {
      const { name } = each.thing;
      /** @type {SpritePiece} */
      const piece = {
        name,
        appearance: this.appearance(each, inside, related, doing),
        scale: this.scale(each.thing),
        rise,
        contents: contentsOf(name, placed, inside).map((one) =>
          this.appearance(one, inside, related),
        ),
      };
      rise += this.constant(each.thing, "STACK_OFFSET", HEIGHT);
      return piece;
    });
  }

  /** Return the size in tiles at which an object is drawn. @param {Thing} thing */
  scale(thing) {
    return this.constant(thing, "SCALE", SCALES[this.role(thing)]);
  }

  /** Return all pictures that objects of a kind may get. @param {string} kind */
  files(kind) {
    const arts = [...parts(this.entity(kind)?.assets ?? readArt({}))];
    return arts.flatMap(({ asset, stages }) => (asset ? [asset, ...stages] : stages));
  }

  /** @param {Thing} thing @returns {Role} */
  role({ kind, type }) {
    if (this.task?.stationTypes.has(type)) return "station";
    if (this.task?.playerTypes.has(type)) return "player";
    const isContainer = type === "container" || this.groups.container.entities.has(kind);
    return isContainer ? "container" : "item";
  }

  /** @param {string} kind */
  groupOf(kind) {
    return Object.values(this.groups).find((group) => group.entities.has(kind)) ?? null;
  }

  /** @param {string} kind */
  entity(kind) {
    return this.groupOf(kind)?.entities.get(kind) ?? null;
  }

  /** @param {Thing} thing @param {string} name @param {number} fallback */
  constant(thing, name, fallback) {
    const other = this.role(thing) === "container" ? this.groups.container : this.groups.item;
    const group = this.groupOf(thing.kind) ?? other;
    const own = group.entities.get(thing.kind)?.constants.get(name);
    const value = own ?? group.constants.get(name);
    if (value === undefined) return fallback;
    // Objects at the same height would hide each other.
    return name === "STACK_OFFSET" ? Math.max(0.04, value) : value;
  }

  /** Return words for the predicates that describe an object's state, rather than its place. */
  statesOfThings() {
    const { task } = this;
    if (task === null) return /** @type {Map<string, string>} */ (new Map());
    let found = this.states.get(task);
    if (found === undefined) {
      found = statesOfThings(task);
      this.states.set(task, found);
    }
    return found;
  }
}

/**
 * Return the nearest wanted object that carries an object, however deeply it is nested; or null.
 * @param {SceneSprites} stage @param {string} name @param {(host: string) => boolean} wanted
 */
export function hostOf({ placed }, name, wanted) {
  let host = placed.get(name)?.host ?? null;
  for (let i = 0; i < placed.size && host !== null; i += 1) {
    if (wanted(host)) return host;
    host = placed.get(host)?.host ?? null;
  }
  return null;
}

/** @param {Task} task @param {string} type */
function isHolder(task, type) {
  return task.stationTypes.has(type) || task.playerTypes.has(type);
}

/**
 * Return the objects that each object hosts, such as the water in a pot.
 * @param {Map<string, Placed>} placed
 */
export function insides(placed) {
  /** @type {Map<string, Placed[]>} */
  const found = new Map();
  for (const each of placed.values()) if (each.host !== null) append(found, each.host, each);
  return found;
}

/**
 * Return everything added to an object or to what is inside it, at any depth.
 * @param {string} name @param {Map<string, Placed>} placed @param {Map<string, Placed[]>} inside
 */
function contentsOf(name, placed, inside) {
  /** @type {Set<string>} */
  const found = new Set();
  const pending = [name];
  // Objects are followed once each, so that cyclic relations of a custom domain end.
  const seen = new Set(pending);
  for (let current = pending.pop(); current !== undefined; current = pending.pop()) {
    const own = placed.get(current)?.contents ?? [];
    const more = own.filter((other) => placed.has(other) && !found.has(other));
    for (const other of more) found.add(other);
    for (const other of [...(inside.get(current) ?? []).map((each) => each.thing.name), ...more]) {
      if (!seen.has(other)) pending.push(other);
      seen.add(other);
    }
  }
  return [...found].map((other) => /** @type {Placed} */ (placed.get(other)));
}

/**
 * Return the timed actions in progress for each object, with the share that is done.
 * @param {State} state
 */
function underWay(state) {
  /** @type {Doing} */
  const doing = new Map();
  for (const row of state.progress()) {
    if (!row.timed || !row.running) continue;
    const share = row.done / Math.max(1, row.total);
    for (const name of [row.subject, ...row.arguments]) {
      const actions = doing.get(name) ?? new Map();
      actions.set(row.action, Math.max(share, actions.get(row.action) ?? 0));
      doing.set(name, actions);
    }
  }
  return doing;
}

/**
 * Return the facts that relate each object to others, with kinds in place of names.
 * @param {State} state
 */
function relations(state) {
  /** @type {Related} */
  const related = new Map();
  for (const [predicate, ...names] of state.atoms()) {
    const fact = [predicate, ...names.map((name) => state.objects.get(name)?.kind ?? "")];
    for (const name of new Set(names)) append(related, name, fact);
  }
  return related;
}

/** @param {Task} task */
function statesOfThings(task) {
  const { domain } = task;
  // Predicates that the layout implies describe places, which the picture shows anyway.
  const places = new Set((domain.layout ?? []).map((/** @type {any} */ rule) => rule.predicate));
  const kinds = /** @type {string[][]} */ (Object.values(domain.kinds ?? {})).flat();
  const aboutKinds = new Set(kinds.map((kind) => `is${kind}`));
  /** @type {Set<string>} */
  const changed = new Set();
  for (const action of domain.action_defs) {
    for (const each of action.immediate_fx ?? []) changed.add(each.predicate);
    const effects = [...(action.sfx ?? [])];
    for (let effect = effects.pop(); effect !== undefined; effect = effects.pop()) {
      effects.push(...(effect.sfx ?? []));
      if (effect.type === "creation") continue;
      for (const each of effect.fx ?? []) changed.add(each.predicate);
    }
  }
  /** @type {Map<string, string>} */
  const found = new Map();
  for (const { name, param_types: types } of domain.predicate_defs) {
    const isState = changed.has(name) && !places.has(name) && !aboutKinds.has(name);
    if (isState && types.length === 1 && !isHolder(task, types[0])) {
      found.set(name, name.replace(/^is/, "").replace(/^has/, "").replaceAll("_", " "));
    }
  }
  return found;
}
