/**
 * Names of stations by their place, such as `the left table at the top`.
 *
 * In a picture no station has a number. Each station is at a side of the kitchen or in the middle,
 * in a row with the others of the same name.
 *
 * @typedef {import("./floor.js").Floor} Floor
 * @typedef {import("./floor.js").Tile} Tile
 * @typedef {import("./language.js").PlaceWords} PlaceWords
 * @typedef {"top" | "bottom" | "left" | "right" | "middle"} Side
 */
import { filled, PLACES } from "./language.js";

/** Distance in tiles from an edge within which a station belongs to that side. */
const MAX_ASIDE = 1;

/**
 * Name each station by its place. All names differ.
 * @param {Floor} floor
 * @param {Map<string, string>} nouns Nouns of the stations by object name.
 * @param {PlaceWords} words
 */
export function placeNames(floor, nouns, words) {
  const called = named(floor, nouns, words);
  const names = [...called.values()];
  // A language's own words may name two stations alike.
  return new Set(names).size < names.length || names.includes("")
    ? named(floor, nouns, PLACES)
    : called;
}

/** @param {Floor} floor @param {Map<string, string>} nouns @param {PlaceWords} words */
function named(floor, nouns, words) {
  /** @type {Map<string, {noun: string, side: Side, tiles: Map<string, Tile>}>} */
  const rows = new Map();
  for (const [name, noun] of nouns) {
    const tile = /** @type {Tile} */ (floor.stations.get(name));
    const side = sideOf(floor, tile);
    const row = rows.get(`${side} ${noun}`) ?? { noun, side, tiles: new Map() };
    row.tiles.set(name, tile);
    rows.set(`${side} ${noun}`, row);
  }
  return new Map([...rows.values()].flatMap((row) => inRow(row, words)));
}

/** @param {Floor} floor @param {Tile} tile @returns {Side} */
function sideOf(floor, [x, y]) {
  /** @type {[Side, number][]} */
  const edges = [
    ["top", floor.height - 1 - y],
    ["bottom", y],
    ["left", x],
    ["right", floor.width - 1 - x],
  ];
  const least = Math.min(...edges.map(([, far]) => far));
  const nearest = edges.find(([, far]) => far === least);
  return nearest && least <= MAX_ASIDE ? nearest[0] : "middle";
}

/**
 * Name the stations that share a noun and a side.
 * @param {{noun: string, side: Side, tiles: Map<string, Tile>}} row @param {PlaceWords} words
 * @returns {[string, string][]}
 */
function inRow({ noun, side, tiles }, words) {
  const base = { noun, side: words[side] };
  if (tiles.size === 1) return [...tiles.keys()].map((name) => [name, filled(words.single, base)]);
  // Rows at the left and right sides, and columns in the middle, are counted from the top.
  const columns = new Set([...tiles.values()].map(([x]) => x));
  const upright = side === "left" || side === "right" || columns.size === 1;
  const along = (/** @type {Tile} */ [x, y]) => (upright ? [-y, x] : [x, -y]);
  const names = [...tiles]
    .map(([name, tile]) => ({ name, place: along(tile) }))
    .sort((a, b) => a.place[0] - b.place[0] || a.place[1] - b.place[1])
    .map(({ name }) => name);
  const order = upright ? words.downwards : words.across;
  if (names.length <= order.length) {
    const few = names.length === order.length ? order : [order[0], order[order.length - 1]];
    return names.map((name, i) => [name, filled(words.one_of_few, { ...base, order: few[i] })]);
  }
  return names.map((name, i) => {
    const number = words.ordinals[i] ?? `${i + 1}.`;
    return [name, filled(words.one_of_many, { ...base, number })];
  });
}
