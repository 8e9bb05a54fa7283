/**
 * Words of a domain's rendering file, with the defaults of `robotouille.domain.rendering`.
 *
 * @typedef {{name: string, when?: string | null}} KindName
 * @typedef {{name: string, bottom: string, top: string, begun?: string}} DishName
 * @typedef {typeof PLACES} PlaceWords
 * @typedef {{
 *   kinds: Map<string, KindName[]>, actions: Map<string, {do: string, how?: string}>,
 *   predicates: Map<string, {needed?: string, forbidden?: string}>, states: Map<string, string>,
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
  const { kinds, actions, predicates, states, dishes, places, work, signals, other } = raw ?? {};
  const named = (/** @type {any} */ each) => (typeof each === "string" ? { name: each } : each);
  const done = (/** @type {any} */ each) => (typeof each === "string" ? { do: each } : each);
  return {
    kinds: mapped(kinds, (each) => [each].flat().map(named)),
    actions: mapped(actions, done),
    predicates: mapped(predicates, (each) => each),
    states: mapped(states, (each) => each),
    dishes: dishes ?? [],
    places: { ...PLACES, ...places },
    work: { ...WORK, ...work },
    signals: { ...SIGNALS, ...signals },
    other: other ?? "the other {noun}",
  };
}

/** @param {any} object @param {(value: any) => any} read */
const mapped = (object, read) =>
  new Map(Object.entries(object ?? {}).map(([key, value]) => [key, read(value)]));
