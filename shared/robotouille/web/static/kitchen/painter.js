/** Drawing of the kitchen on a canvas, as the window draws it. */

import { workInProgress } from "../rules/work.js";
import { HEAD, Layout, RAISED, between, freePlace, occupied, sizesOf } from "./layout.js";
import { spots, up, wayOf } from "./layout.js";
import { hostOf } from "./look.js";
import { BEATS, CHEER_SECONDS, Motion, gestures, stepAnimation } from "./motion.js";
import { INK, PAPER, SEATS, Sprites, badgeURL } from "./pictures.js";

/** @typedef {import("../rules/task.js").Task} Task */
/** @typedef {import("../rules/state.js").State} State */
/** @typedef {import("./look.js").Look} Look */
/** @typedef {import("./look.js").Appearance} Appearance */
/** @typedef {import("./look.js").SceneSprites} SceneSprites */
/** @typedef {import("./look.js").Side} Side */
/** @typedef {import("./look.js").SpritePiece} SpritePiece */
/** @typedef {import("./layout.js").Spot} Spot */
/** @typedef {import("./layout.js").Box} Box */
/** @typedef {import("./motion.js").Point} Point */
/** @typedef {import("./motion.js").Pose} Pose */
/** @typedef {import("./motion.js").Animation} Animation */
/** @typedef {import("./motion.js").Gesture} Gesture */

const SHADE = "rgb(38 34 43 / 55%)";
const RIM = "#685c5c";
const FAINT = "#b2a8ba";
const ABSENT = "#605a64";
const BAD = "#f48478";
/** @type {[number, number, number]} */
const ACCENT = [255, 196, 84];
/** @type {[number, number, number]} */
const GOOD = [126, 201, 110];
const FATES = new Map([["asked", PAPER], ["done", `rgb(${GOOD})`], ["rejected", BAD]]);
const FONT = `"Helvetica Neue", Helvetica, Arial, "Liberation Sans", sans-serif`;

/** Share of the wall that is above its skirting, and of that what a picture takes. */
const WALL_FREE = 0.8;
const HUNG = 0.94;
/** Tiles between two pictures on the wall, and the size in tiles of what stands in the room. */
const APART = 2.5;
const STANDING = 0.9;
/** Height of a tool over an object, and the length of its stroke, in tiles. */
const TOOL = 0.18;
const STROKE = 0.16;
/** Movements of an object that cooks, in a step, and how far it moves, in tiles. */
const SHAKES = 1.5;
const SHAKEN = 0.012;
/** Height of the arc of a taken object, in tiles. */
const ARC = 0.24;
/** Objects that swim in a container: their size, visible share, surface and opening. */
const SWIMMING = 0.36;
const ABOVE = 0.7;
const SURFACE = 0.06;
const OPENING = 0.5;
/** Share by which a squat or stretched picture is wider or narrower. */
const SQUASH = 0.05;
/** Sizes and shades of a particle; pictures a second while only particles move. */
const FRAMES = 12;
const EFFECT_PICTURES = 10;
const GOLDEN = 0.618;
const RING_STEPS = 48;
/** Top of a name below the top of its player's tile, in tiles. */
const FEET = 0.83;
/** Seconds of a step if the episode's clock has none. */
const STEP_SECONDS = 0.2;

/**
 * Return whether a game reached its goal, or was a shift with points.
 * @param {{reason?: string, score?: {points: number}} | null | undefined} outcome
 */
export const won = (outcome) =>
  outcome?.reason === "shift_over" ? (outcome.score?.points ?? 0) > 0 : outcome?.reason === "goal";

/** @typedef {{player: string, name: string, present: boolean}} Seat */
/** @typedef {ReturnType<typeof workInProgress>} Work */
/**
 * @typedef {{key: string, before: State | null, state: State, animation: Animation, work: Work,
 *   then: Work, advances: boolean}} Animated
 */
/**
 * @typedef {{state: State, step: number, before: State | null, seconds: number, at: number}} Shown
 */
/**
 * @typedef {{step: number, before: State | null, stepSeconds?: number | null, receivedAt: number,
 *   outcome?: {reason?: string, score?: {points: number}} | null}} Moment
 */

export class Kitchen {
  /**
   * @param {HTMLCanvasElement} canvas @param {Task} task @param {Look} look
   * @param {string | null} me The player of the person at this page.
   */
  constructor(canvas, task, look, me = null) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (
      canvas.getContext("2d", { alpha: false })
    );
    this.task = task;
    this.look = look;
    this.me = me;
    /** @type {Seat[]} Who plays, for the names under the players. */
    this.seats = [];
    /** @type {Set<string>} Players for whom the step waits. */
    this.waitsFor = new Set();
    /** @type {Set<string>} Players whose last action was rejected. */
    this.rejected = new Set();
    /** @type {{player: string, target: string}[]} What signals point at. */
    this.pointing = [];
    /** @type {string | null} The station under the mouse. */
    this.hover = null;
    /** @type {{station: string, fate: "asked" | "done" | "rejected"} | null} */
    this.mark = null;
    /** @type {"" | "won" | "lost"} */
    this.outcome = "";
    this.quiet = matchMedia("(prefers-reduced-motion: reduce)");
    this.reducedMotion = false;
    this.resized = new ResizeObserver(() => this.resizeToPage());
    this.seatColours = task.players.map((_, seat) => SEATS[seat % SEATS.length]);
    this.sprites = new Sprites(look, () => {});
    this.motion = new Motion();
    this.layout = new Layout(300, 150, task.problem.width, task.problem.height, 1);
    /** Resolves when the pictures of the first frame are decoded. */
    this.begun = this.sprites.load(this.first());
    /** Resolves when all pictures of the look are decoded. */
    this.ready = this.others();
    /** @type {Shown | null} */
    this.shown = null;
    /** Number of states shown so far. */
    this.changes = 0;
    /** @type {Animated | null} What moves in the step, computed once for all its frames. */
    this.animated = null;
    /** @type {HTMLCanvasElement | null} */
    this.room = null;
    /** @type {Map<string, string>} Stations as the room's picture shows them. */
    this.drawnStations = new Map();
    /** @type {number | null} Time at which the outcome was first drawn. */
    this.ended = null;
    this.lastKey = "";
    /** @type {Generator<[string, number]> | null} */
    this.coming = null;
    /** @type {Map<string, number>} Number of the choice at which each name is. */
    this.tagPlaces = new Map();
    /** @type {Map<string, Pose>} */
    this.poses = new Map();
    /** @type {Map<string, Spot>} */
    this.spots = new Map();
  }

  /**
   * Show a state from now on. `before` is the state one step earlier, if it is known.
   * @param {State} state @param {Moment} moment
   */
  show(state, { step, before, stepSeconds, receivedAt, outcome }) {
    const seconds = stepSeconds && stepSeconds > 0 ? stepSeconds : STEP_SECONDS;
    this.outcome = !outcome ? "" : won(outcome) ? "won" : "lost";
    if (this.shown?.state !== state || this.shown.step !== step) this.changes += 1;
    this.shown = { state, step, before, seconds, at: receivedAt };
  }

  /** Draw in the size that the canvas has on the page, until `close`. */
  fit() {
    this.resized.observe(this.canvas);
    this.resizeToPage();
  }

  resizeToPage() {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth) this.resize(clientWidth, clientHeight, devicePixelRatio);
  }

  close() {
    this.resized.disconnect();
  }

  /** @param {number} cssWidth @param {number} cssHeight @param {number} pixelRatio */
  resize(cssWidth, cssHeight, pixelRatio = 1) {
    const [width, height] = [Math.round(cssWidth * pixelRatio), Math.round(cssHeight * pixelRatio)];
    this.canvas.width = Math.max(1, width);
    this.canvas.height = Math.max(1, height);
    const { width: columns, height: rows } = this.task.problem;
    this.layout = new Layout(width, height, columns, rows, pixelRatio);
    this.room = null;
    this.lastKey = "";
    void this.begun.then(() => {
      this.coming = this.likely();
    });
  }

  /** Decode the other pictures, one with each frame: many at once would delay a frame. */
  async others() {
    await this.begun;
    for (const file of this.look.pictures.keys()) {
      if (this.sprites.images.has(file)) continue;
      await new Promise(requestAnimationFrame);
      await this.sprites.load([file]);
    }
  }

  /** Return the pictures of the room, and those that the task is likely to need. */
  first() {
    const { default: usual, wall, tiles = {}, on_wall: hung = [], beside = [] } =
      this.look.rendering.floor ?? {};
    const room = [usual, wall, ...Object.values(tiles), ...hung, ...beside];
    return new Set([...room, ...[...this.likely()].map(([file]) => file)]);
  }

  /**
   * Yield the pictures that the task is likely to need, with their sizes: one is drawn ahead with
   * each frame, because many at once would delay a frame.
   * @returns {Generator<[string, number]>}
   */
  *likely() {
    const { look, task } = this;
    const { tile } = this.layout;
    for (const [index, name] of task.players.entries()) {
      const kind = task.things.get(name)?.kind ?? "";
      for (const side of /** @type {Side[]} */ (["front", "back", "left", "right"])) {
        const looks = [false, true].map((full) => look.player(kind, index, side, full).asset);
        const shut = look.shutEyes(kind, index, side);
        for (const file of [...looks, shut, ...look.feet(kind, index, side)]) {
          if (file) yield [file, tile];
        }
      }
    }
    for (const thing of task.things.values()) {
      for (const file of look.files(thing.kind)) {
        for (const size of sizesOf(look.scale(thing) * tile)) yield [file, size];
      }
    }
  }

  /**
   * Return the station at a point, or else the uppermost object there.
   * @param {number} cssX @param {number} cssY @returns {string | null}
   */
  targetAt(cssX, cssY) {
    const { ratio } = this.layout;
    const tile = this.layout.tileAt(cssX * ratio, cssY * ratio);
    if (!tile || !this.shown) return null;
    const { placed, stations } = this.look.stage(this.shown.state);
    /** @type {string | null} */
    let found = null;
    let least = Infinity;
    for (const [name, each] of placed) {
      if (!each.tile || each.tile[0] !== tile[0] || each.tile[1] !== tile[1]) continue;
      const rank = stations.has(name) ? -1 : each.level;
      if (rank < least) [found, least] = [name, rank];
    }
    return found;
  }

  /**
   * Return the middle of a picture and the side of a tile in CSS pixels; null if it is not visible.
   * @param {string} name
   */
  spotOf(name) {
    const spot = this.spots.get(name);
    if (!spot) return null;
    const { ratio, tile } = this.layout;
    return { x: spot.x / ratio, y: spot.y / ratio, tile: tile / ratio };
  }

  /** Return the look of a station, a player or a visible object, or null. @param {string} name */
  appearanceOf(name) {
    return this.shown && this.look.shown(this.look.stage(this.shown.state), name);
  }

  /**
   * Draw the state at a time, if the picture has changed. Return whether it was drawn.
   * @param {number} now Seconds on the clock of `receivedAt`.
   */
  draw(now) {
    // Each picture that is still decoded would change the room.
    if (!this.shown || !this.coming) return false;
    const { state, before, step, seconds, at } = this.shown;
    const [file, size] = this.coming.next().value ?? [null, 0];
    if (file) this.sprites.file(file, size);
    const still = this.quiet.matches;
    this.reducedMotion = still;
    const passed = before ? Math.min(1, Math.max(0, (now - at) / seconds)) : 1;
    const poses = this.motion.poses(state, before, step, passed);
    if (!this.outcome) this.ended = null;
    else if (this.ended === null) this.ended = now;
    const since = this.ended === null ? null : now - this.ended;
    // The effects of the end last as long as the players cheer.
    const animation = this.animation(state, before, (since ?? 0) < CHEER_SECONDS ? this.outcome : "");
    const stage = this.look.stage(state);
    const phase = this.visiblePhase(passed, animation);
    const flown = Math.floor((still ? 0 : Math.min(since ?? 0, CHEER_SECONDS)) * EFFECT_PICTURES);
    const held = new Set([...poses.keys()].filter((name) => stage.piles.has(name)));
    const { outcome } = this;
    const moment = { phase, seconds: now, since, outcome, still, held };
    const postures = gestures(poses, animation, moment);
    const key = this.key([phase, flown], postures);
    if (key === this.lastKey) return false;
    this.lastKey = key;
    this.poses = phase === passed ? poses : this.motion.poses(state, before, step, phase);
    this.spots = spots(this.layout, stage, this.poses);
    const earlier = before ? spots(this.layout, this.look.stage(before), this.poses) : this.spots;
    const time = step + phase + flown / EFFECT_PICTURES / seconds;
    this.paint({ state, before, stage, animation, postures, phase, earlier, time });
    return true;
  }

  /**
   * Return a text that changes whenever the picture would.
   * @param {number[]} times The phase, and the pictures of effects since the end of the game.
   * @param {Map<string, Gesture>} postures
   */
  key(times, postures) {
    const { sprites, me, hover, mark, pointing } = this;
    return JSON.stringify([
      times, sprites.revision, me, hover, mark, pointing, this.outcome,
      [...postures.values()], this.seats, [...this.waitsFor], [...this.rejected],
      this.changes,
    ]);
  }

  /** @param {State} state @param {State | null} before @param {string} key The outcome, if any. */
  animation(state, before, key) {
    const { animated } = this;
    if (animated?.state === state && animated.before === before && animated.key === key) {
      return animated.animation;
    }
    const animation = stepAnimation(this.look, state, before, key);
    const known = animated && animated.state === before ? animated.work : null;
    const [work, then] = [workInProgress(state), known ?? (before ? workInProgress(before) : [])];
    const advances = JSON.stringify(before?.progress()) !== JSON.stringify(state.progress());
    this.animated = { key, state, before, animation, work, then, advances };
    return animation;
  }

  /**
   * Return the visible phase of the step. Particles alone need fewer pictures.
   * @param {number} phase @param {Animation} animation
   */
  visiblePhase(phase, { working, emissions, tools, travels }) {
    const { before, step, seconds } = /** @type {Shown} */ (this.shown);
    if (!before) return 1;
    const lively = !this.reducedMotion;
    const works = lively && working.size + tools.length > 0;
    const moves = works || travels.size > 0 || this.motion.walking(step);
    if (moves || this.animated?.advances) return phase;
    if (!lively || emissions.length === 0) return 1;
    const pictures = Math.max(1, Math.round(EFFECT_PICTURES * seconds));
    return Math.floor(phase * pictures) / pictures;
  }

  /** @param {Frame} frame */
  paint(frame) {
    const { context, layout } = this;
    context.drawImage(this.background(frame.stage), 0, 0);
    this.highlight(frame.stage);
    // Rows nearer to the viewer cover those behind; in a row, players cover objects.
    /** @type {[number, number, string][]} */
    const rows = [...this.poses].map(([name, { at }]) => [-at[1], 1, name]);
    for (const host of frame.stage.piles.keys()) {
      const tile = frame.stage.placed.get(host)?.tile;
      if (tile && !this.poses.has(host)) rows.push([-tile[1], 0, host]);
    }
    rows.sort((a, b) => a[0] - b[0] || a[1] - b[1] || (a[2] < b[2] ? -1 : 1));
    for (const [, isPlayer, name] of rows) {
      if (isPlayer) this.player(frame, name);
      else this.pile(frame, name, 0);
    }
    const ways = this.travels(frame);
    if (frame.animation.tools.length > 0) this.tools(frame);
    if (!this.reducedMotion) this.particles(frame);
    this.pointedAt(frame.stage);
    const signs = [...this.progress(frame), ...this.signs(frame)];
    this.marked(frame.stage);
    this.tags([...occupied(layout, frame.stage, this.poses, this.spots), ...signs, ...ways]);
  }

  // Room

  /**
   * Return everything behind what moves, drawn again only where a station looks different.
   * @param {SceneSprites} stage
   */
  background(stage) {
    const { layout, sprites } = this;
    if (!this.room) {
      this.room = document.createElement("canvas");
      this.room.width = layout.width;
      this.room.height = layout.height;
      this.drawnStations = new Map();
    }
    const context = /** @type {CanvasRenderingContext2D} */ (this.room.getContext("2d"));
    if (this.drawnStations.get("") !== String(sprites.revision)) {
      this.drawRoom(context);
      this.drawnStations = new Map([["", String(sprites.revision)]]);
    }
    for (const [name, appearance] of stage.stations) {
      const look = `${appearance.asset} ${appearance.words}`;
      const tile = stage.placed.get(name)?.tile;
      if (!tile || this.drawnStations.get(name) === look) continue;
      this.drawnStations.set(name, look);
      const [x, y] = layout.corner(tile);
      this.floor(context, tile);
      const picture = sprites.of(appearance, layout.tile);
      if (picture) context.drawImage(picture, x, y);
    }
    return this.room;
  }

  /** @param {CanvasRenderingContext2D} context */
  drawRoom(context) {
    const { layout } = this;
    const { tile, edge, rows, columns } = layout;
    const [left, top, width, height] = layout.kitchen;
    const first = -Math.ceil(left / tile);
    const last = Math.ceil((layout.width - left) / tile);
    const below = -Math.ceil((layout.height - top - height) / tile);
    for (let x = first; x < last; x += 1) {
      this.wall(context, left + x * tile, top + layout.wall);
      for (let y = below; y < rows; y += 1) this.floor(context, [x, y]);
    }
    this.hang(context, last - first);
    this.stand(context, rows, columns);
    const inside = new Path2D();
    inside.rect(left, top, width, height);
    const around = new Path2D();
    around.rect(0, 0, layout.width, layout.height);
    around.addPath(inside);
    context.fillStyle = SHADE;
    context.fill(around, "evenodd");
    const line = new Path2D();
    line.roundRect(left - edge, top - edge, width + 2 * edge, height + 2 * edge, edge * 1.6);
    line.addPath(inside);
    context.fillStyle = INK;
    context.fill(line, "evenodd");
  }

  /** @param {CanvasRenderingContext2D} context @param {Point} tile */
  floor(context, tile) {
    const { layout, look } = this;
    const row = layout.rows - 1 - tile[1];
    const letter = this.task.problem.ground?.[row]?.[tile[0]] ?? "";
    const art = look.rendering.floor ?? {};
    const tiles = new Map(Object.entries(art.tiles ?? {}));
    const picture = this.sprites.file(tiles.get(letter) ?? art.default, layout.tile);
    const [x, y] = layout.corner(tile);
    context.fillStyle = (tile[0] + row) % 2 ? "#ece2ce" : "#e2d6c0";
    if (picture) context.drawImage(picture, x, y);
    else context.fillRect(x, y, layout.tile, layout.tile);
  }

  /** @param {CanvasRenderingContext2D} context @param {number} left @param {number} foot */
  wall(context, left, foot) {
    const { tile } = this.layout;
    const picture = this.sprites.file(this.look.rendering.floor?.wall, tile);
    context.fillStyle = "#c4d6ca";
    if (!picture) {
      context.fillRect(left, 0, tile, foot);
      return;
    }
    context.drawImage(picture, left, foot - tile);
    // Above its picture, the wall goes on without a skirting.
    const free = Math.max(1, Math.round(tile * WALL_FREE));
    for (let bottom = foot - tile; bottom > 0; bottom -= free) {
      context.drawImage(picture, 0, 0, tile, free, left, bottom - free, tile, free);
    }
  }

  /**
   * Hang pictures on the wall, evenly from the middle of the kitchen to both sides.
   * @param {CanvasRenderingContext2D} context
   * @param {number} count Columns of the room.
   */
  hang(context, count) {
    const { layout } = this;
    const pictures = this.look.rendering.floor?.on_wall ?? [];
    const side = Math.round(layout.wall * WALL_FREE * HUNG);
    if (pictures.length === 0 || side < 1) return;
    const step = Math.round(APART * layout.tile);
    const [left, top, width] = layout.kitchen;
    const y = top + Math.round((layout.wall * WALL_FREE) / 2) - Math.floor(side / 2);
    const most = Math.floor((count * layout.tile) / step) + 1;
    for (let number = -most; number <= most; number += 1) {
      const index = ((number % pictures.length) + pictures.length) % pictures.length;
      const picture = this.sprites.file(pictures[index], side);
      const x = left + Math.floor(width / 2) + number * step - Math.floor(side / 2);
      const edges = [left - layout.edge, left + width + layout.edge];
      const onEdge = edges.some((edge) => x < edge && edge < x + side);
      if (picture && !onEdge) context.drawImage(picture, x, y);
    }
  }

  /**
   * Put things on the floor of the margins, where they are wide enough.
   * @param {CanvasRenderingContext2D} context @param {number} rows @param {number} columns
   */
  stand(context, rows, columns) {
    const { layout } = this;
    const things = this.look.rendering.floor?.beside ?? [];
    const side = Math.round(STANDING * layout.tile);
    if (things.length === 0 || layout.left < side + layout.edge) return;
    for (let row = 0; row < rows; row += 3) {
      for (const [column, number] of [[-1, row / 3], [columns, row / 3 + 1]]) {
        const picture = this.sprites.file(things[number % things.length], side);
        const [x, y] = layout.part([column, row], [0.5, 0.5, 0, 0]);
        if (picture) context.drawImage(picture, Math.round(x - side / 2), Math.round(y - side / 2));
      }
    }
  }

  // Players and objects

  /** @param {Frame} frame @param {string} name */
  player(frame, name) {
    const { context, look, sprites } = this;
    const { tile: size } = this.layout;
    const gesture = frame.postures.get(name);
    const spot = this.spots.get(name);
    if (!gesture || !spot) return;
    const index = this.task.players.indexOf(name);
    const kind = this.task.things.get(name)?.kind ?? "";
    if (name === this.me) {
      context.globalAlpha = 0.51;
      context.fillStyle = this.seatColours[index];
      context.beginPath();
      const y = spot.y + (0.31 + RAISED) * size;
      context.ellipse(spot.x, y, size * 0.4, size * 0.14, 0, 0, 2 * Math.PI);
      context.fill();
      context.globalAlpha = 1;
    }
    const body = up(spot, gesture.lift);
    const feet = look.feet(kind, index, gesture.facing);
    if (feet.length > 0) this.picture(feet[gesture.stride % feet.length], spot, size);
    const appearance =
      gesture.arms === "up"
        ? look.cheering(kind, index)
        : look.player(kind, index, gesture.facing, gesture.arms === "out");
    const picture = sprites.of(appearance, size);
    if (picture) {
      const change = Math.round(SQUASH * gesture.squash * size);
      const [wide, high] = [size + change, size - change];
      const foot = Math.round(body.y + size / 2);
      context.drawImage(picture, Math.round(body.x - wide / 2), foot - high, wide, high);
    }
    if (gesture.shut && gesture.squash === 0) {
      this.picture(look.shutEyes(kind, index, gesture.facing), body, size);
    }
    this.pile(frame, name, gesture.lift);
  }

  /** @param {string | null | undefined} file @param {Spot} spot @param {number} size */
  picture(file, { x, y }, size) {
    const side = Math.max(1, Math.round(size));
    const picture = this.sprites.file(file, side);
    if (picture) {
      this.context.drawImage(picture, Math.round(x - side / 2), Math.round(y - side / 2));
    }
  }

  /**
   * Draw the objects on a station or in a player's hands, some tiles higher.
   * @param {Frame} frame @param {string} host @param {number} lift
   */
  pile(frame, host, lift) {
    const { travels, shaken } = frame.animation;
    const pieces = frame.stage.piles.get(host) ?? [];
    pieces.forEach((piece, i) => {
      let spot = this.spots.get(piece.name);
      if (!spot || travels.has(piece.name)) return;
      if (!this.reducedMotion && shaken.has(piece.name)) {
        const aside = SHAKEN * spot.tile * Math.sin(2 * Math.PI * SHAKES * frame.time);
        spot = { ...spot, x: spot.x + aside };
      }
      this.piece(piece, up(spot, lift), i === pieces.length - 1);
    });
  }

  /**
   * Draw one object, and its contents if nothing lies on top.
   * @param {SpritePiece} piece @param {Spot} spot
   */
  piece({ appearance, scale, contents }, { x, y, tile }, whole = true) {
    const size = Math.max(1, Math.round(scale * tile));
    const picture = this.sprites.of(appearance, size);
    if (picture) {
      this.context.drawImage(picture, Math.round(x - size / 2), Math.round(y - size / 2));
    }
    // Small pictures swim in a pot, with their lower part under the surface.
    const swimming = whole ? contents.slice(0, 4) : [];
    const side = Math.max(1, Math.round(SWIMMING * scale * tile));
    const gap = (OPENING * scale * tile) / Math.max(1, swimming.length);
    const seen = Math.round(side * ABOVE);
    const top = Math.round(y - SURFACE * scale * tile) - seen;
    swimming.forEach((each, i) => {
      const left = Math.round(x + (i - (swimming.length - 1) / 2) * gap - side / 2);
      const small = this.sprites.of(each, side);
      if (small) this.context.drawImage(small, 0, 0, side, seen, left, top, side, seen);
    });
  }

  /**
   * Draw objects on their way between two places, in a low arc. Return the areas of their ways.
   * @param {Frame} frame
   */
  travels({ stage, earlier, animation, phase }) {
    const share = phase * phase * (3 - 2 * phase);
    /** @type {Box[]} */
    const ways = [];
    for (const piece of animation.travels.size > 0 ? [...stage.piles.values()].flat() : []) {
      const end = this.spots.get(piece.name);
      if (!animation.travels.has(piece.name) || !end) continue;
      const start = earlier.get(piece.name) ?? end;
      const on = between(start, end, share);
      this.piece(piece, up(on, ARC * Math.sin(Math.PI * share)));
      ways.push(wayOf(piece, start, end));
    }
    return ways;
  }

  /** Draw tools over the objects that they work on. @param {Frame} frame */
  tools({ animation, time }) {
    for (const { tool, target } of animation.tools) {
      const spot = this.spots.get(target);
      if (!spot) continue;
      const wave = this.reducedMotion ? 0 : Math.sin(2 * Math.PI * BEATS * time);
      const scrubs = tool.motion === "scrub";
      const lift = scrubs ? TOOL : TOOL + STROKE * Math.abs(wave);
      const x = spot.x + (TOOL / 2 + (scrubs ? STROKE * wave : 0)) * spot.tile;
      this.picture(tool.asset, { ...up(spot, lift), x }, (tool.size ?? 0.5) * spot.tile);
    }
  }

  /** @param {Frame} frame */
  particles({ animation, time }) {
    const { context } = this;
    for (const { effect, source } of animation.emissions) {
      const spot = this.spots.get(source);
      if (!spot) continue;
      const { count = 3, steps = 3, start = 0, rise = 0.4, spread = 0.12 } = effect;
      const [first, last] = effect.size ?? [0.1, 0.2];
      for (let number = 0; number < Math.min(count, 8); number += 1) {
        const age = (time / steps + number / count) % 1;
        const look = Math.round(age * FRAMES) / FRAMES;
        // The golden ratio spreads the particles evenly, without a random generator.
        const lean = Math.sin(2 * Math.PI * GOLDEN * (number + 1 + source.length));
        const x = spot.x + lean * spread * spot.tile * (0.4 + 0.6 * age);
        const y = spot.y - (start + rise * age) * spot.tile;
        context.globalAlpha = 1 - look ** 2;
        const size = Math.max(2, (first + (last - first) * look) * spot.tile);
        this.picture(effect.asset, { x, y, tile: spot.tile }, size);
      }
    }
    context.globalAlpha = 1;
  }

  // Signs

  /**
   * Stroke a box with round corners inside its edge.
   * @param {Box} box @param {number} width @param {number} radius @param {string} colour
   */
  outline([x, y, w, h], width, radius, colour) {
    const { context } = this;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.roundRect(x + width / 2, y + width / 2, w - width, h - width, radius - width / 2);
    context.stroke();
  }

  /**
   * Mark the station under the mouse, below the objects and players there.
   * @param {SceneSprites} stage
   */
  highlight(stage) {
    const placed = stage.placed.get(this.hover ?? "");
    if (!placed?.tile) return;
    const { context } = this;
    const { tile, ratio } = this.layout;
    const width = Math.max(2, Math.floor(tile / 28));
    const [x, y, w, h] = this.layout.part(placed.tile, [0, 0, 1, 1]);
    const radius = tile / 10;
    context.fillStyle = "rgb(255 250 240 / 17%)";
    context.fillRect(x, y, w, h);
    this.outline([x - ratio, y - ratio, w + 2 * ratio, h + 2 * ratio], ratio, radius, INK);
    this.outline([x, y, w, h], width, radius, PAPER);
    const inner = /** @type {Box} */ ([x + width, y + width, w - 2 * width, h - 2 * width]);
    this.outline(inner, ratio, Math.max(1, radius - width), "rgb(59 47 47 / 59%)");
  }

  /** Outline the station of the local player's last action. @param {SceneSprites} stage */
  marked(stage) {
    const tile = stage.placed.get(this.mark?.station ?? "")?.tile;
    if (!tile || !this.mark) return;
    const side = this.layout.tile;
    const width = Math.max(2, Math.floor(side / 20));
    const box = this.layout.part(tile, [0.05, 0.05, 0.9, 0.9]);
    this.outline(box, width, side / 8, FATES.get(this.mark.fate) ?? PAPER);
  }

  /**
   * Mark what signals point at, in the colour of the player who points.
   * @param {SceneSprites} stage
   */
  pointedAt(stage) {
    const side = this.layout.tile;
    for (const { player, target } of this.pointing) {
      const holder = hostOf(stage, target, (host) => this.poses.has(host)) ?? target;
      const at = this.poses.get(holder)?.at ?? stage.placed.get(target)?.tile;
      const seat = this.task.players.indexOf(player);
      if (!at || seat < 0) continue;
      const width = Math.max(3, Math.floor(side / 14));
      const colour = ground(this.seatColours[seat]);
      this.outline(this.layout.part(at, [0, 0, 1, 1]), width, side / 5, colour);
      this.outline(this.layout.part(at, [0.1, 0.1, 0.8, 0.8]), width / 2, side / 5, colour);
    }
  }

  /**
   * Draw the progress of work as rings at stations. Return the covered areas.
   * @param {Frame} frame @returns {Box[]}
   */
  progress({ stage, phase }) {
    const { work, then: earlier } = /** @type {Animated} */ (this.animated);
    const key = (/** @type {{action: string, arguments: string[]}} */ row) =>
      `${row.action}(${row.arguments})`;
    const then = new Map(earlier.map((row) => [key(row), row.done]));
    const side = Math.max(12, Math.round(0.46 * this.layout.tile));
    /** @type {Map<string, number>} */
    const taken = new Map();
    return work.flatMap((row) => {
      const holder = hostOf(stage, row.subject, (host) => this.poses.has(host));
      const at = holder ? this.poses.get(holder)?.at : stage.placed.get(row.subject)?.tile;
      if (!at) return [];
      // Badges at one place stand side by side.
      const number = taken.get(`${at}`) ?? 0;
      taken.set(`${at}`, number + 1);
      const start = then.get(key(row)) ?? 0;
      const done = row.done >= start ? start + (row.done - start) * phase : row.done;
      const steps = Math.round(Math.min(1, done / Math.max(1, row.total)) * RING_STEPS);
      const [x, y] = this.layout.part(at, holder ? [0.12, 0.1, 0, 0] : [0.8, 0.12, 0, 0]);
      const left = Math.round(x - number * side * 0.95 - side / 2);
      const top = Math.round(y - side / 2);
      this.ring(row, steps, left, top, side);
      return [/** @type {Box} */ ([left, top, side, side])];
    });
  }

  /**
   * Draw a disc whose rim is filled by `steps` of RING_STEPS, with the action's icon or letter.
   * @param {{action: string, running: boolean}} row @param {number} steps @param {number} left
   * @param {number} top @param {number} side
   */
  ring({ action, running }, steps, left, top, side) {
    const { context, sprites } = this;
    const share = steps / RING_STEPS;
    const mixed = ACCENT.map((value, i) => Math.round(value + (GOOD[i] - value) * share));
    const middle = side / 2;
    const disc = sprites.kept(`ring ${side} ${steps} ${running}`, side, side, (drawn) => {
      const turn = -Math.PI / 2;
      for (const [reach, colour, end] of /** @type {[number, string, number][]} */ ([
        [1, INK, 1],
        [0.93, RIM, 1],
        [0.93, running ? `rgb(${mixed})` : FAINT, share],
        [0.64, PAPER, 1],
      ])) {
        drawn.fillStyle = colour;
        drawn.beginPath();
        if (end < 1) drawn.moveTo(middle, middle);
        drawn.arc(middle, middle, middle * reach, turn, turn + 2 * Math.PI * end);
        drawn.fill();
      }
    });
    context.globalAlpha = running ? 1 : 0.67;
    context.drawImage(disc, left, top);
    context.globalAlpha = running ? 1 : 0.43;
    const icon = sprites.file(this.look.progress.get(action), Math.round(side * 0.66));
    if (icon) {
      const inset = Math.round((side - icon.width) / 2);
      context.drawImage(icon, left + inset, top + inset);
    } else {
      // A rendering need not have a picture for every action.
      context.fillStyle = INK;
      context.font = `bold ${Math.round(side / 2)}px ${FONT}`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillText(action.slice(0, 1).toUpperCase(), left + middle, top + middle);
    }
    context.globalAlpha = 1;
  }

  /**
   * Draw the icons of busy and rejected players. Return the covered areas.
   * @param {Frame} frame @returns {Box[]}
   */
  signs({ state }) {
    const side = Math.round(0.3 * this.layout.tile);
    return [...this.poses].flatMap(([name, pose]) => {
      const busy = state.busySteps(name) > 0 && !pose.walking;
      const icon = this.rejected.has(name) ? "rejected" : busy ? "busy" : "";
      if (!icon) return [];
      const [x, y] = this.layout.part(pose.at, [0.85, 0, 0, 0]);
      this.picture(this.look.icons.get(icon), { x, y, tile: side }, side);
      return [/** @type {Box} */ ([x - side / 2, y - side / 2, side, side])];
    });
  }

  // Names

  /** @param {Box[]} taken Areas that no name may cover. */
  tags(taken) {
    const { layout, context } = this;
    const side = layout.tile;
    const own = (/** @type {string} */ name) => (name === this.me ? 0 : 1);
    const players = [...this.poses.keys()].sort((a, b) => own(a) - own(b));
    for (const name of players) {
      const tag = this.tag(name);
      if (!tag) continue;
      const [width, height] = [tag.width, tag.height];
      const [x, y] = layout.corner(/** @type {Pose} */ (this.poses.get(name)).at);
      const middle = x + side / 2 - width / 2;
      /** @type {Point[]} */
      const choices = [
        [middle, y + FEET * side],
        [middle, y + HEAD * side - height],
        [x - width + 0.18 * side, y + 0.45 * side],
        [x + 0.82 * side, y + 0.45 * side],
      ];
      // A name that jumps cannot be read, so that of a walker stays where it is if it can.
      const { walking } = /** @type {Pose} */ (this.poses.get(name));
      const kept = choices[walking ? (this.tagPlaces.get(name) ?? 0) : 0];
      const size = /** @type {Point} */ ([width, height]);
      const place =
        freePlace([kept, ...choices], size, layout, taken) ??
        freePlace(choices, size, layout, []);
      if (!place) continue;
      const number = choices.findIndex(
        ([left, top]) => Math.abs(left - place[0]) < 1 && Math.abs(top - place[1]) < 1,
      );
      this.tagPlaces.set(name, Math.max(0, number));
      context.drawImage(tag, place[0], place[1]);
      taken.push(place);
    }
  }

  /** Return the badge of a seat with the name of its participant. @param {string} player */
  tag(player) {
    const { context, layout, sprites } = this;
    const seat = this.task.players.indexOf(player);
    const participant = this.seats.find((each) => each.player === player);
    const here = !participant?.name || participant.present;
    const size = Math.max(10 * layout.ratio, Math.min(layout.text, Math.floor(layout.tile / 6)));
    const font = `bold ${Math.round(size * 0.9)}px ${FONT}`;
    const name = participant?.name || player;
    const key = JSON.stringify(["tag", player, name, here, this.waitsFor.has(player), size]);
    const known = sprites.cache.get(key);
    if (known) return known;
    context.font = font;
    const words = fitted(context, name, layout.tile * 1.5);
    const text = this.waitsFor.has(player) ? `${words}  …` : words;
    const letters = Math.ceil(context.measureText(text).width);
    const height = Math.round(size * 0.95) + 2;
    const side = Math.round(height * 1.15);
    const badge = sprites.drawn(`badge ${seat} ${here}`, () => this.badge(seat, here), side);
    if (!badge) return null;
    const width = letters + height - 2 + Math.floor((side * 2) / 3);
    return sprites.kept(key, width, side, (drawn) => {
      const plate = letters + height - 2;
      drawn.fillStyle = here ? ground(this.seatColours[seat]) : ABSENT;
      drawn.beginPath();
      drawn.roundRect(width - plate, (side - height) / 2, plate, height, height / 2);
      drawn.fill();
      drawn.font = font;
      drawn.fillStyle = PAPER;
      drawn.textAlign = "center";
      drawn.textBaseline = "middle";
      drawn.fillText(text, width - plate / 2, side / 2 + size * 0.06);
      drawn.drawImage(badge, 0, 0);
    });
  }

  /** @param {number} seat @param {boolean} here */
  badge(seat, here) {
    return badgeURL(seat, here ? this.seatColours[seat] : FAINT);
  }
}

/**
 * @typedef {{state: State, before: State | null, stage: SceneSprites, animation: Animation,
 *   postures: Map<string, Gesture>, phase: number, time: number, earlier: Map<string, Spot>}} Frame
 */

/**
 * Return a text, cut off with an ellipsis if it is wider than `width`.
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} width
 */
function fitted(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  const letters = [...text.slice(0, 60)];
  while (letters.length > 0 && context.measureText(`${letters.join("")}…`).width > width) {
    letters.pop();
  }
  return `${letters.join("").trimEnd()}…`;
}

/**
 * Return a seat's colour darkened until PAPER letters can be read on it (WCAG 2.2, 4.6 to 1).
 * @param {string} colour
 */
function ground(colour) {
  const parts = (/** @type {string} */ hex) =>
    [1, 3, 5].map((at) => Number.parseInt(hex.slice(at, at + 2), 16));
  const light = (/** @type {number[]} */ rgb) => {
    const [r, g, b] = rgb.map((value) => {
      const share = value / 255;
      return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
  };
  const [own, ink] = [parts(colour), parts(INK)];
  const mix = (/** @type {number[]} */ from, /** @type {number} */ share) =>
    from.map((value, i) => Math.round(value + (ink[i] - value) * share));
  const base = mix(own, 0.2);
  for (let share = 0; share < 1; share += 0.05) {
    const shown = mix(base, share);
    if (light(parts(PAPER)) / light(shown) >= 4.6) return `rgb(${shown})`;
  }
  return INK;
}
