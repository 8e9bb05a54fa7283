/**
 * Objects, actions and reasons in plain words, from a domain's language.
 *
 * For anything the language does not name, the domain's sentences and kind names are used.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Schema} Schema
 * @typedef {import("./state.js").State} State
 * @typedef {import("./scene.js").Placed} Placed
 * @typedef {import("./actions.js").Action} Action
 * @typedef {import("./actions.js").Unmet} Unmet
 * @typedef {import("./work.js").Work} Work
 * @typedef {import("./language.js").Language} Language
 */
import { bindingOf } from "./actions.js";
import { fields, filled, readLanguage } from "./language.js";
import { placeNames } from "./places.js";
import { scene } from "./scene.js";
import { byText } from "./task.js";
import { preparationOf } from "./work.js";

/** Most kinds that a reason lists. */
const MAX_KINDS = 3;
/** The word before the acting player at the end of a sentence, and what comes before it. */
const LAST_WORD = /^(.*?)\s+[\p{L}\p{N}_]+\s+$/su;
const [SOMEBODY, SOMETHING, SOMEWHERE] = ["somebody", "something", "some place"];

/** Return a text with a capital first letter. @param {string} words */
export function capitalised(words) {
  const [first = ""] = words;
  return first.toUpperCase() + words.slice(first.length);
}

/** Return a task's title, such as `Lettuce burger`. @param {string} name */
export function taskTitle(name) {
  const file = name.slice(name.lastIndexOf("/") + 1).replace(/\.json$/, "");
  return capitalised(file.replace(/^\d+_/, "").replaceAll("_", " "));
}

/** Words for one reader in one task. */
export class Wording {
  /**
   * @param {Task} task
   * @param {any} language The `language` of the rendering file, or a result of `readLanguage`.
   * @param {string | null} me Player of the reader, called `you`.
   * @param {Map<string, string>} names Names of the participants by player.
   */
  constructor(task, language, me = null, names = new Map()) {
    this.task = task;
    /** @type {Language} */
    this.language = language?.kinds instanceof Map ? language : readLanguage(language);
    this.me = me;
    this.names = names;
    this.preparation = preparationOf(task);
    this.occupancy = this.preparation.occupancy;
    /** @type {{state: State, places: Map<string, string>} | null} */
    this._lately = null;
    /** @type {Map<string, string> | null} */
    this._sides = null;
  }

  // Things

  /** Return the name of a kind, whatever its state. @param {string} kind */
  kind(kind) {
    const found = this.language.kinds.get(kind)?.find(({ when }) => (when ?? null) === null);
    return found ? found.name : kind.replaceAll("_", " ");
  }

  /** Return the name of an object, such as `the pot`. @param {string} name @param {State} state */
  thing(name, state) {
    if (name === this.me) return "you";
    const participant = this.names.get(name);
    if (participant !== undefined) return participant;
    const noun = this._noun(name, state);
    const number = this.task.players.includes(name) ? numberOf(name) : "";
    return number ? `${noun} ${number}` : `the ${noun}`;
  }

  /**
   * Return a station's unique name, such as `the left table at the top`.
   * @param {string} station @param {State} state
   */
  place(station, state) {
    return this.places(state).get(station) || this.thing(station, state);
  }

  /** Return the names of all stations by object name; all differ. @param {State} state */
  places(state) {
    // All names of a state are needed together, and several times in one frame.
    if (this._lately?.state !== state) this._lately = { state, places: this._places(state) };
    return this._lately.places;
  }

  /**
   * Name each station by its noun, else by what lies on it, else by its place.
   * @param {State} state
   */
  _places(state) {
    const stations = [...this.task.floor.stations.keys()];
    const nouns = new Map(stations.map((name) => [name, this._noun(name, state)]));
    const laid = this._laid(nouns, state);
    const [alike, told] = [counted(nouns.values()), counted(laid.values())];
    return new Map(
      [...nouns].map(([name, noun]) => {
        if (alike.get(noun) === 1) return [name, `the ${noun}`];
        const words = laid.get(name) ?? "";
        return [name, told.get(words) === 1 ? words : this._side(name)];
      }),
    );
  }

  /**
   * Name stations by the dish on them, or by the lowest object.
   * @param {Map<string, string>} nouns @param {State} state
   */
  _laid(nouns, state) {
    /** @type {Map<string, Placed[]>} */
    const stacks = new Map();
    for (const each of [...scene(state).values()].sort((a, b) => a.level - b.level)) {
      if (each.host === null || !nouns.has(each.host)) continue;
      stacks.set(each.host, [...(stacks.get(each.host) ?? []), each]);
    }
    /** @type {Map<string, string>} */
    const laid = new Map();
    for (const [name, stack] of stacks) {
      if (stack[0].level !== 0) continue;
      const words = { noun: nouns.get(name) ?? "", things: this._stack(stack, state) };
      laid.set(name, filled(this.language.places.with_things, words));
    }
    return laid;
  }

  /**
   * Name a stack from the bottom up, such as `the burger` or `the cut tomato`.
   * @param {Placed[]} stack @param {State} state
   */
  _stack(stack, state) {
    const [bottom, top] = [stack[0].thing, stack[stack.length - 1].thing];
    // A pile of one kind is a supply, not a dish.
    if (stack.some(({ thing }) => thing.kind !== bottom.kind)) {
      const dish = this.language.dishes.find((each) => each.bottom === bottom.kind);
      if (dish) {
        const done = dish.top === top.kind && stack.length > 2;
        return `the ${(done ? dish.name : dish.begun) || dish.name}`;
      }
    }
    return this.thing(bottom.name, state);
  }

  /** @param {string} station */
  _side(station) {
    if (!this._sides) {
      const { floor, things } = this.task;
      const nouns = [...floor.stations.keys()].map(
        (name) => /** @type {[string, string]} */ ([name, this.kind(things.get(name)?.kind ?? "")]),
      );
      this._sides = placeNames(floor, new Map(nouns), this.language.places);
    }
    return this._sides.get(station) ?? "";
  }

  /**
   * Return the names of several objects in one sentence, with equal names told apart.
   * @param {Iterable<string>} names @param {State} state
   */
  things(names, state) {
    const called = new Map([...new Set(names)].map((name) => [name, this.thing(name, state)]));
    const sounds = counted(called.values());
    /** @type {Map<string, number>} */
    const heard = new Map();
    for (const [name, sound] of called) {
      const alike = sounds.get(sound) ?? 0;
      if (alike < 2) continue;
      const before = heard.get(sound) ?? 0;
      called.set(name, this._apart(name, state, before, alike));
      heard.set(sound, before + 1);
    }
    return called;
  }

  /**
   * Return the name of one of several objects with the same name.
   * @param {string} name @param {State} state @param {number} before @param {number} alike
   */
  _apart(name, state, before, alike) {
    if (this.places(state).has(name)) return this.place(name, state);
    const noun = this._noun(name, state);
    if (alike === 2) return before ? filled(this.language.other, { noun }) : `the ${noun}`;
    return `${noun} ${numberOf(name)}`.trim();
  }

  /** @param {string} name @param {State} state */
  _noun(name, state) {
    const kind = state.kindOf(name);
    const found = this.language.kinds.get(kind)?.find(({ when }) =>
      (when ?? null) === null || state.truths(when ?? "").some((atom) => atom.includes(name, 1)));
    const noun = found ? found.name : kind.replaceAll("_", " ");
    const { states } = this.language;
    const facts = states.size ? scene(state).get(name)?.facts : undefined;
    const told = [...states].flatMap(([fact, word]) => (facts?.has(fact) ? word : []));
    return [...told, noun].join(" ");
  }

  /** Return each kind of station that has words for its purpose, with these; special ones first. */
  purposes() {
    const { floor, things } = this.task;
    const kinds = new Set([...floor.stations.keys()].map((name) => things.get(name)?.kind));
    const told = [...this.language.purposes].filter(([kind]) => kinds.has(kind)).reverse();
    return told.map(([kind, use]) => [this.kind(kind), use]);
  }

  // Actions

  /**
   * Return an action in words, such as `cut the lettuce`.
   * @param {Action} action @param {State} state
   */
  action(action, state) {
    const words = this.language.actions.get(action.name);
    const template = (words?.alike && this._isAboutAlike(action) && words.alike) || words?.do;
    const told = template ? this._filled(template, action, state) : "";
    return told || lower(this._filled(withoutPlayer(action), action, state));
  }

  /** Return whether two objects of an action are of one kind. @param {Action} action */
  _isAboutAlike(action) {
    const kinds = action.args.map((name) => this.task.things.get(name)?.kind);
    return new Set(kinds).size < kinds.length;
  }

  /** Return an action without its objects, such as `cut something`. @param {Schema} schema */
  inGeneral(schema) {
    const { floor, things } = this.task;
    const stations = new Set([...floor.stations.keys()].map((name) => things.get(name)?.type));
    const whatever = new Map(
      schema.parameters.map(([n, type]) => [n, stations.has(type) ? SOMEWHERE : SOMETHING]),
    );
    const template = this.language.actions.get(schema.name)?.do ?? "";
    return filled(template, whatever) || schema.name.replaceAll("-", " ");
  }

  /** Return what a place is for, given the actions possible there. @param {Schema[]} schemas */
  here(schemas) {
    const words = this.language.work;
    const does = [...new Set(schemas.map((each) => this.inGeneral(each)))];
    return does.length ? filled(words.here, { actions: does.join(words.either) }) : "";
  }

  /**
   * Return work that has to come first, such as `fill the pot with water first, at the sink`.
   * If the work is already going on, say to wait for it.
   * @param {Work} work @param {State} state
   */
  first(work, state) {
    const words = this.language.work;
    const { schema, binding, places } = work;
    if (this.preparation.isUnderWay(state, work)) return words.under_way;
    const template = this.language.actions.get(schema.name)?.do ?? "";
    const called = this.things(binding.values(), state);
    const named = new Map(fields(template).map((name) => [name, SOMETHING]));
    for (const [name, thing] of binding) named.set(name, called.get(thing) ?? "");
    const action = filled(template, named) || schema.name.replaceAll("-", " ");
    const place = this._where(places, state);
    return filled(place ? words.first_at : words.first, { action, place });
  }

  /**
   * Name one of several stations, such as `a stove`; empty if they are of several kinds.
   * @param {string[]} stations @param {State} state
   */
  _where(stations, state) {
    const kinds = new Set(stations.map((name) => state.kindOf(name)));
    if (kinds.size !== 1) return "";
    if (stations.length === 1) return this.place(stations[0], state);
    return withArticle(this.kind([...kinds][0]));
  }

  /**
   * Return what to do to make an action possible.
   * @param {Action} action @param {Unmet[]} unmet @param {State} state
   */
  way(action, unmet, state) {
    const reasons = () => new Set(unmet.map((each) => this.reason(each, state)));
    return this._how(action, unmet, state) || [...reasons()].join("; ");
  }

  /**
   * Return the language's own advice for an action with several unmet conditions.
   * @param {Action} action @param {Unmet[]} unmet @param {State} state
   */
  _how(action, unmet, state) {
    const words = this.language.actions.get(action.name);
    return words?.how && unmet.length > 1 ? this._filled(words.how, action, state) : "";
  }

  /** @param {string} template @param {Action} action @param {State} state */
  _filled(template, action, state) {
    const named = new Set(fields(template));
    const things = [...bindingOf(action)].filter(([name]) => named.has(name));
    const called = this.things(things.map(([, thing]) => thing), state);
    const end = action.schema.definition.travel?.[1];
    const there = things.find(([name]) => name === end);
    if (there) called.set(there[1], this.place(there[1], state));
    const words = things.map(([name, thing]) => /** @type {const} */ ([name, called.get(thing)]));
    return filled(template, new Map(words.map(([name, word]) => [name, word ?? ""])));
  }

  // Reasons

  /**
   * Return what is missing for an action, in its way, or to be done first.
   * @param {Unmet} unmet @param {State} state
   */
  reason(unmet, state) {
    const { kind, predicate, objects } = unmet;
    if (kind === "condition" && predicate) return this._condition(unmet, state);
    if (!objects.length) return unmet.words;
    const [who] = this._known(objects, state);
    if (kind === "missing") return `${who} is not there`;
    if (kind === "busy") return `${who} ${who === "you" ? "are" : "is"} still busy`;
    return kind === "turn" ? `it is ${who}'s turn` : unmet.words;
  }

  /** @param {Unmet} unmet @param {State} state */
  _condition(unmet, state) {
    const { predicate, objects, expected } = unmet;
    const known = objects.every((name) => state.thing(name));
    const work = expected && known ? this.preparation.workFor(predicate, objects, state) : null;
    // Advice helps more than naming the missing fact.
    if (work) return this.first(work, state);
    const words = this.language.predicates.get(predicate);
    const template = (expected ? words?.needed : words?.forbidden) ?? "";
    const called = this._known(objects, state, predicate);
    const told = filled(template, { who: this._standing(unmet, state) || SOMEBODY }, called);
    if (told) return told;
    const kinds = expected && called.length === 1 ? this._kinds(predicate, state) : [];
    if (kinds.length) return `needs ${kinds.join(" or ")}, which ${called[0]} is not`;
    const fact = this.task.describe([predicate, ...this._known(objects, state, "", false)]);
    return expected ? `needs: ${fact}` : `not while ${fact}`;
  }

  /**
   * Return who stands where nobody may, if the condition is about that.
   * @param {Unmet} unmet @param {State} state
   */
  _standing(unmet, state) {
    const station = this.occupancy.neededFree(unmet);
    if (station === null) return "";
    const other = this.occupancy.playersAt(state, station).find((name) => name !== this.me);
    return other === undefined ? "" : this.thing(other, state);
  }

  /**
   * Return the names of objects; unknown objects keep their identifiers.
   * @param {string[]} objects @param {State} state
   * @param {string} predicate If it is about standing, stations get unique names.
   * @param {boolean} you If false, the reader's player gets its noun, for a domain's sentences.
   */
  _known(objects, state, predicate = "", you = true) {
    const called = this.things(objects.filter((name) => state.thing(name)), state);
    if (predicate && this.occupancy.isAboutStanding(predicate)) {
      const places = this.places(state);
      for (const name of called.keys()) {
        const place = places.get(name);
        if (place !== undefined) called.set(name, place);
      }
    }
    if (!you && this.me !== null && called.has(this.me)) {
      called.set(this.me, `the ${this._noun(this.me, state)}`);
    }
    return objects.map((name) => called.get(name) ?? name);
  }

  /**
   * Return the kinds for which a static predicate holds, if there are few: `a board`.
   * @param {string} predicate @param {State} state
   */
  _kinds(predicate, state) {
    const atoms = (this.task.statics.get(predicate) ?? []).filter(({ length }) => length === 2);
    const holding = atoms.map(([, name]) => name).sort(byText);
    const kinds = [...new Set(holding.map((name) => this.kind(state.kindOf(name))))];
    return kinds.length <= MAX_KINDS ? kinds.map(withArticle) : [];
  }
}

/** @param {Iterable<string>} texts */
function counted(texts) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  for (const text of texts) counts.set(text, (counts.get(text) ?? 0) + 1);
  return counts;
}

/** @param {string} name */
const numberOf = (name) => /\d+$/.exec(name)?.[0] ?? "";

/** @param {string} noun */
const withArticle = (noun) => `${"aeiou".includes(noun.slice(0, 1)) ? "an" : "a"} ${noun}`;

/** @param {string} words */
const lower = (words) => words.slice(0, 1).toLowerCase() + words.slice(1);

/**
 * Return the domain's sentence without `… with {p1}`, or else without `{p1}`.
 * @param {Action} action
 */
function withoutPlayer({ schema }) {
  const template = schema.definition.language_description;
  if (!schema.player) return template;
  const field = `{${schema.parameters[0][0]}}`;
  const end = template.trimEnd();
  const shorter = end.endsWith(field) ? LAST_WORD.exec(end.slice(0, -field.length)) : null;
  return shorter ? shorter[1] : template.replace(` ${field}`, "");
}
