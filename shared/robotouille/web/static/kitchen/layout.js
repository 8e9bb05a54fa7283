/**
 * Geometry of a drawn state in device pixels: tiles, and the spots of players and objects.
 * A port of `window/drawing/window_layout.py` and `window/drawing/kitchen/spots.py`.
 */

/** @typedef {import("./motion.js").Pose} Pose */
/** @typedef {import("./motion.js").Point} Point */
/** @typedef {import("./look.js").SceneSprites} SceneSprites */
/** @typedef {import("./look.js").SpritePiece} SpritePiece */
/** @typedef {{x: number, y: number, tile: number}} Spot Centre of a picture, and its tile size. */
/** @typedef {[number, number, number, number]} Box Left, top, width and height. */

const MARGIN = 8;
/** Height of the wall in tiles: usual, and lowest where tiles would shrink otherwise. */
const WALL = 1;
const LOW_WALL = 0.55;
/** Canvas side divided by the letters' height. */
const LETTERS = 40;
/** Tiles by which a player is drawn above its tile. */
export const RAISED = 0.12;
/** Top of a player's picture below the top of its tile, in tiles. */
export const HEAD = -0.14;
/** Share of a picture's square that an object usually fills. */
const SEEN = 0.76;
/** Size of a held object, as a share of its usual size, and its place. */
const HELD_SCALE = 0.85;
/** @type {Record<string, Point>} */
const HELD = { front: [0, 0.18], right: [0.35, 0.09], left: [-0.35, 0.09], back: [0, -0.58] };

/** Grid of square tiles with a wall above. */
export class Layout {
  /**
   * @param {number} width @param {number} height @param {number} columns @param {number} rows
   * @param {number} ratio Device pixels in a CSS pixel.
   */
  constructor(width, height, columns, rows, ratio) {
    const margin = Math.round(MARGIN * ratio);
    const [roomX, roomY] = [width - 2 * margin, height - 2 * margin];
    this.width = width;
    this.height = height;
    this.columns = columns;
    this.rows = rows;
    this.ratio = ratio;
    this.edge = Math.round(6 * ratio);
    this.tile = Math.max(8, Math.floor(Math.min(roomX / columns, roomY / (rows + LOW_WALL))));
    const free = roomY / this.tile - rows;
    this.wall = Math.round(this.tile * Math.min(WALL, Math.max(LOW_WALL, free)));
    this.left = margin + Math.floor((roomX - this.tile * columns) / 2);
    const above = Math.floor((roomY - rows * this.tile - this.wall) / 2);
    // On a high canvas, such as that of a phone, more floor looks better than more wall.
    this.top = margin + Math.min(above, this.tile) + this.wall;
    this.text = Math.round(Math.max(11 * ratio, Math.min(width, height) / LETTERS));
  }

  /** @returns {Box} Area of the wall and the floor. */
  get kitchen() {
    const { left, top, wall, tile } = this;
    return [left, top - wall, this.columns * tile, this.rows * tile + wall];
  }

  /**
   * Return the upper left pixel of a tile, or of a point between tiles.
   * @param {Point} tile @returns {Point}
   */
  corner([x, y]) {
    return [this.left + x * this.tile, this.top + (this.rows - 1 - y) * this.tile];
  }

  /** @param {number} x @param {number} y @returns {Point | null} */
  tileAt(x, y) {
    const column = Math.floor((x - this.left) / this.tile);
    const row = Math.floor((y - this.top) / this.tile);
    const inside = column >= 0 && column < this.columns && row >= 0 && row < this.rows;
    return inside ? [column, this.rows - 1 - row] : null;
  }

  /**
   * Return a part of a tile, given in tiles.
   * @param {Point} tile @param {Box} part @returns {Box}
   */
  part(tile, [left, top, width, height]) {
    const [x, y] = this.corner(tile);
    const side = this.tile;
    return [x + left * side, y + top * side, width * side, height * side];
  }
}

/** Return a spot some tiles higher. @param {Spot} spot @param {number} tiles @returns {Spot} */
export const up = ({ x, y, tile }, tiles) => ({ x, y: y - tiles * tile, tile });

/**
 * Return a spot between two, with one of a few tile sizes: each size is another picture.
 * @param {Spot} from @param {Spot} to @param {number} share @returns {Spot}
 */
export function between(from, to, share) {
  return {
    x: from.x + (to.x - from.x) * share,
    y: from.y + (to.y - from.y) * share,
    tile: from.tile + ((to.tile - from.tile) * Math.round(share * 2)) / 2,
  };
}

/**
 * Return the sizes of a picture on stations, in hands and on the way between the two.
 * @param {number} size
 */
export const sizesOf = (size) => [size, size * HELD_SCALE, (size * (1 + HELD_SCALE)) / 2];

/** @param {SpritePiece} piece @param {Spot} spot @returns {Box} */
function around({ scale }, { x, y, tile }) {
  const side = scale * tile * SEEN;
  return [x - side / 2, y - side / 2, side, side];
}

/**
 * Return the area that an object passes through.
 * @param {SpritePiece} piece @param {Spot} from @param {Spot} to @returns {Box}
 */
export function wayOf(piece, from, to) {
  const [[x, y, w, h], [u, v, wide, high]] = [around(piece, from), around(piece, to)];
  const [left, top] = [Math.min(x, u), Math.min(y, v)];
  return [left, top, Math.max(x + w, u + wide) - left, Math.max(y + h, v + high) - top];
}

/**
 * Return the spot of the lowest object on a station, on the floor or in a player's hands.
 * @param {Layout} layout @param {SceneSprites} stage @param {string} host
 * @param {Map<string, Pose>} poses @returns {Spot | null}
 */
function pileSpot(layout, stage, host, poses) {
  const pose = poses.get(host);
  if (pose) {
    const [dx, dy] = HELD[pose.facing];
    const [x, y] = layout.part(pose.at, [0.5 + dx, 0.5 - RAISED + dy, 0, 0]);
    return { x, y, tile: layout.tile * HELD_SCALE };
  }
  const tile = stage.placed.get(host)?.tile;
  if (!tile) return null;
  const [x, y] = layout.part(tile, [0.5, 0.5 - (stage.bases.get(host) ?? 0), 0, 0]);
  return { x, y, tile: layout.tile };
}

/**
 * Return the spots of all players, stations and objects.
 * @param {Layout} layout @param {SceneSprites} stage @param {Map<string, Pose>} poses
 */
export function spots(layout, stage, poses) {
  /** @type {Map<string, Spot>} */
  const found = new Map();
  for (const [name, pose] of poses) {
    const [x, y] = layout.part(pose.at, [0.5, 0.5 - RAISED, 0, 0]);
    found.set(name, { x, y, tile: layout.tile });
  }
  for (const name of stage.stations.keys()) {
    const tile = stage.placed.get(name)?.tile;
    if (!tile) continue;
    const [x, y] = layout.part(tile, [0.5, 0.4, 0, 0]);
    found.set(name, { x, y, tile: layout.tile });
  }
  for (const [host, pieces] of stage.piles) {
    const base = pileSpot(layout, stage, host, poses);
    if (base) for (const piece of pieces) found.set(piece.name, up(base, piece.rise));
  }
  for (const [name, { host }] of stage.placed) {
    const there = found.get(host ?? "");
    if (there && !found.has(name)) found.set(name, there);
  }
  return found;
}

/**
 * Return the areas that no label may cover: players, objects, and the worktops of used stations.
 * @param {Layout} layout @param {SceneSprites} stage @param {Map<string, Pose>} poses
 * @param {Map<string, Spot>} all @returns {Box[]}
 */
export function occupied(layout, stage, poses, all) {
  const areas = [...poses.values()].map(({ at }) => layout.part(at, [0.2, HEAD, 0.6, 0.96]));
  const used = new Set(stage.piles.keys());
  for (const name of poses.keys()) used.add(stage.placed.get(name)?.at ?? "");
  for (const piece of [...stage.piles.values()].flat()) {
    const spot = all.get(piece.name);
    if (spot) areas.push(around(piece, spot));
  }
  for (const name of stage.stations.keys()) {
    const tile = used.has(name) ? stage.placed.get(name)?.tile : null;
    if (tile) areas.push(layout.part(tile, [0.06, 0.14, 0.88, 0.56]));
  }
  return areas;
}

/**
 * Return the first choice for a label that overlaps nothing, or undefined.
 * @param {Point[]} choices Upper left corners, the preferred one first.
 * @param {Point} size @param {Layout} layout @param {Box[]} taken @returns {Box | undefined}
 */
export function freePlace(choices, [width, height], layout, taken) {
  const clamped = choices.map(([x, y]) => {
    const left = Math.max(0, Math.min(Math.round(x), layout.width - width));
    const top = Math.max(0, Math.min(Math.round(y), layout.height - height));
    return /** @type {Box} */ ([left, top, width, height]);
  });
  // Places are rounded, so that neighbours may overlap by less than a pixel.
  return clamped.find(([x, y]) =>
    taken.every(([left, top, wide, high]) => {
      const aside = x > left + wide - 1 || left > x + width - 1;
      return aside || y > top + high - 1 || top > y + height - 1;
    }),
  );
}
