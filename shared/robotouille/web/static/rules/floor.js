/**
 * Tiles of a grid without a station, and walks over them.
 *
 * @typedef {[number, number]} Tile
 * @typedef {import("./task.js").Thing} Thing
 */

/** Number of keys for each column: tiles have coordinates below 100. */
const COLUMN = 128;
/** South comes first: there, a player who faces the station turns its back to the viewer. */
const NEIGHBOURS = [[0, -1], [0, 1], [-1, 0], [1, 0]];

/** @param {Tile} tile */
const key = ([x, y]) => x * COLUMN + y;

export class Floor {
  /**
   * @param {number} width @param {number} height @param {Thing[]} all
   * @param {Set<string>} stationTypes
   */
  constructor(width, height, all, stationTypes) {
    this.width = width;
    this.height = height;
    /** @type {Map<string, Tile>} The tile of each station. */
    this.stations = new Map();
    for (const thing of all) {
      if (stationTypes.has(thing.type) && thing.tile) this.stations.set(thing.name, thing.tile);
    }
    /** Stations at which players only put things down, usually tables. */
    this.plain = plain(all, stationTypes);
    this._blocked = new Set([...this.stations.values()].map(key));
    // Only players have a direction; their tiles are where walks begin.
    this._starts = all.flatMap(({ facing, tile }) => (facing && tile ? [tile] : []));
    /** @type {Map<number, Map<number, Tile>>} */
    this._walks = new Map();
    /** @type {Set<number> | null} */
    this._reachable = null;
  }

  /** @param {Tile} tile */
  isFree(tile) {
    const [x, y] = tile;
    return x >= 0 && x < this.width && y >= 0 && y < this.height && !this._blocked.has(key(tile));
  }

  /** Return whether some player can reach a free tile from its start. @param {Tile} tile */
  reachable(tile) {
    this._reachable ??= new Set(this._starts.flatMap((start) => [...this._walkFrom(start).keys()]));
    return this._reachable.has(key(tile));
  }

  /**
   * Return the reachable free tiles next to a station, the preferred one first.
   * @param {string} station @returns {Tile[]}
   */
  beside(station) {
    const [x, y] = this._tile(station);
    return NEIGHBOURS.map(([dx, dy]) => /** @type {Tile} */ ([x + dx, y + dy])).filter(
      (tile) => this.isFree(tile) && this.reachable(tile),
    );
  }

  /**
   * Return the tiles to which one can walk from a free tile.
   * @param {Tile} start @param {Tile[]} tiles
   */
  connected(start, tiles) {
    const known = this._walkFrom(start);
    return tiles.filter((tile) => known.has(key(tile)));
  }

  /**
   * Return a shortest walk with both ends; only the ends if none exists.
   * @param {Tile} start @param {Tile} goal
   */
  path(start, goal) {
    const next = this._walkFrom(goal);
    if (!next.has(key(start))) return [start, goal];
    const path = [start];
    for (let tile = start; key(tile) !== key(goal); path.push(tile)) {
      tile = /** @type {Tile} */ (next.get(key(tile)));
    }
    return path;
  }

  /**
   * Return the length of the walk between the tiles from which two stations are used.
   * @param {string} here @param {string} there
   */
  distance(here, there) {
    let [start, goal] = [this._standing(here), this._standing(there)];
    if (!this._walkFrom(goal).has(key(start))) {
      // A counter divides the floor, and one of the stations can be used from both sides.
      let least = Infinity;
      for (const a of this.beside(here)) {
        for (const b of this.connected(a, this.beside(there))) {
          const length = this.path(a, b).length;
          if (length < least) [start, goal, least] = [a, b, length];
        }
      }
    }
    return this.path(start, goal).length - 1;
  }

  /** @param {string} station */
  _standing(station) {
    return this.beside(station)[0] ?? this._tile(station);
  }

  /** @param {string} station @returns {Tile} */
  _tile(station) {
    const tile = this.stations.get(station);
    if (!tile) throw new Error(`no station ${station}`);
    return tile;
  }

  /**
   * Return the next tile on the way to a goal for each tile from which it can be reached.
   * @param {Tile} goal
   */
  _walkFrom(goal) {
    let known = this._walks.get(key(goal));
    if (!known) {
      known = new Map([[key(goal), goal]]);
      const queue = [goal];
      for (const tile of queue) {
        for (const [dx, dy] of NEIGHBOURS) {
          const neighbour = /** @type {Tile} */ ([tile[0] + dx, tile[1] + dy]);
          if (known.has(key(neighbour)) || !this.isFree(neighbour)) continue;
          known.set(key(neighbour), tile);
          queue.push(neighbour);
        }
      }
      // Searching backward from the goal answers all walks to it with one search.
      this._walks.set(key(goal), known);
    }
    return known;
  }
}

/**
 * Return the most frequent kind of station with an empty one at the beginning.
 * @param {Thing[]} things @param {Set<string>} types
 */
function plain(things, types) {
  const place = (/** @type {Thing} */ each) => (each.tile ? key(each.tile) : -1);
  const stations = things.filter((each) => types.has(each.type));
  const used = new Set(things.filter((each) => !types.has(each.type) && !each.facing).map(place));
  const empty = new Set(stations.filter((each) => !used.has(place(each))).map(({ kind }) => kind));
  /** @type {Map<string, number>} */
  const count = new Map();
  for (const { kind } of stations) {
    if (empty.has(kind) || !empty.size) count.set(kind, (count.get(kind) ?? 0) + 1);
  }
  const most = Math.max(...count.values());
  const [chosen] = [...count.keys()].filter((kind) => count.get(kind) === most);
  return new Set(stations.filter((each) => each.kind === chosen).map(({ name }) => name));
}
