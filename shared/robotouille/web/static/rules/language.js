/**
 * Words of a domain's rendering file, with the defaults of `robotouille.domain.rendering`, and the
 * templates in them: names in braces, as Python's formatter reads them. Formats are invalid.
 *
 * @typedef {{name: string, when?: string | null}} KindName
 * @typedef {{name: string, bottom: string, top: string, begun?: string}} DishName
 * @typedef {typeof PLACES} PlaceWords
 * @typedef {{
 *   kinds: Map<string, KindName[]>, actions: Map<string, {do: string, how?: string, alike?: string}>,
 *   predicates: Map<string, {needed?: string, forbidden?: string}>, states: Map<string, string>,
 *   purposes: Map<string, string>,
 *   dishes: DishName[], places: PlaceWords, work: typeof WORK, signals: typeof SIGNALS,
 *   other: string,
 * }} Language
 */

export const PLACES = {
  with_things: "the {noun} with {things}",
  single: "the {noun} {side}",
  one_of_few: "the {order} {noun} {side}",
  one_of_many: "the {number} {noun} {side}",
  top: "at the top",
  bottom: "at the bottom",
  left: "on the left",
  right: "on the right",
  middle: "in the middle",
  across: ["left", "middle", "right"],
  downwards: ["top", "middle", "bottom"],
  ordinals: ["first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"],
};

const WORK = {
  first: "{action} first",
  first_at: "{action} first, at {place}",
  under_way: "wait until it is done",
  here: "here you can {actions}",
  either: " or ",
};

const SIGNALS = {
  need: "I need {thing}, please",
  yours: "you take {thing}, please",
  look: "look at {thing}",
  wait: "wait, please",
  thanks: "thank you",
};

/**
 * Read the `language` of a rendering file. Missing words get their defaults.
 * @param {any} raw @returns {Language}
 */
export function readLanguage(raw) {
  const { kinds, actions, predicates, states, purposes, dishes, places, work, signals } = raw ?? {};
  const named = (/** @type {any} */ each) => (typeof each === "string" ? { name: each } : each);
  const done = (/** @type {any} */ each) => (typeof each === "string" ? { do: each } : each);
  return {
    kinds: mapped(kinds, (each) => [each].flat().map(named)),
    actions: mapped(actions, done),
    predicates: mapped(predicates, (each) => each),
    states: mapped(states, (each) => each),
    purposes: mapped(purposes, (each) => each),
    dishes: dishes ?? [],
    places: { ...PLACES, ...places },
    work: { ...WORK, ...work },
    signals: { ...SIGNALS, ...signals },
    other: raw?.other ?? "the other {noun}",
  };
}

/** @param {any} object @param {(value: any) => any} read */
const mapped = (object, read) =>
  new Map(Object.entries(object ?? {}).map(([key, value]) => [key, read(value)]));

/**
 * Return a template's texts and fields in turn, beginning with a text; null if it is malformed.
 * @param {string} template
 */
function parts(template) {
  const found = [""];
  for (let i = 0; i < template.length; i++) {
    const letter = template[i];
    if (letter === template[i + 1] && (letter === "{" || letter === "}")) {
      found[found.length - 1] += letter;
      i++;
    } else if (letter === "}") {
      return null;
    } else if (letter === "{") {
      const end = template.indexOf("}", i);
      const field = template.slice(i + 1, end);
      if (end < 0 || field.includes("{")) return null;
      found.push(field, "");
      i = end;
    } else {
      found[found.length - 1] += letter;
    }
  }
  return found;
}

/** Return the fields of a template in order; none if it is malformed. @param {string} template */
export function fields(template) {
  return (parts(template) ?? []).filter((field, i) => i % 2 && field);
}

/**
 * Fill a template. Return an empty string if it names unknown fields, or has formats.
 * @param {string} template @param {Map<string, string> | Record<string, string>} words
 * @param {string[]} called Values of `{0}`, `{1}` and so on.
 */
export function filled(template, words, called = []) {
  const known = words instanceof Map ? words : new Map(Object.entries(words));
  const found = parts(template);
  if (!found) return "";
  for (let i = 1; i < found.length; i += 2) {
    const field = found[i] === "" ? String((i - 1) / 2) : found[i];
    const value = /^\d+$/.test(field) ? called[Number(field)] : known.get(field);
    if (value === undefined) return "";
    found[i] = value;
  }
  return found.join("");
}
