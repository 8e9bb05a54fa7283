/**
 * What moves between two states: walks, gestures, objects on their way, tools and particles.
 * A port of `window/drawing/kitchen/{spots,gestures,animation}.py`. Nothing here draws or reads a clock.
 */

import { sameTile, scene } from "../rules/scene.js";
import { hostOf } from "./look.js";

/** @typedef {import("../rules/state.js").State} State */
/** @typedef {import("./look.js").Look} Look */
/** @typedef {import("./look.js").Side} Side */
/** @typedef {import("./look.js").SceneSprites} SceneSprites */
/** @typedef {import("../rules/scene.js").Placed} Placed */
/** @typedef {[number, number]} Point */
/** @typedef {{at: Point, facing: Side, walking: boolean, stride: number}} Pose */
/** @typedef {{path: Point[], began: number, steps: number}} Walk */
/** @typedef {Map<string, Placed>} Scene */

/** Tiles between players that share a tile. */
const SIDE_BY_SIDE = 0.5;
/** Distance in tiles at which walkers begin to step aside, and how far they do so. */
const CLOSE = 1;
const ASIDE = 0.3;

/**
 * Return the point at a share of a path, the direction there and the share of its tile.
 * @param {Point[]} path @param {number} share @returns {[Point, Point, number]}
 */
export function along(path, share) {
  const legs = path.length - 1;
  if (legs < 1) return [path[0], [0, 0], 0];
  const leg = Math.min(legs - 1, Math.floor(share * legs));
  const rest = share * legs - leg;
  const [x, y] = path[leg];
  const [dx, dy] = [path[leg + 1][0] - x, path[leg + 1][1] - y];
  return [[x + dx * rest, y + dy * rest], [dx, dy], rest];
}

/**
 * Return which side of a player is seen when it looks along a vector.
 * @param {Point} direction @returns {Side}
 */
export function looking([dx, dy]) {
  if (Math.abs(dx) > Math.abs(dy)) return dx > 0 ? "right" : "left";
  return dy > 0 ? "back" : "front";
}

/** @param {Walk} walk */
function shareOf(walk, step = 0, phase = 0) {
  return Math.min(1, Math.max(0, (step - walk.began + phase) / walk.steps));
}

/**
 * Walks in progress. A walk of several steps starts where the player was last drawn, and ends when
 * the player is no longer busy. If steps are skipped, players appear at their new places.
 */
export class Motion {
  constructor() {
    this.step = -1;
    /** @type {State | null} */
    this.state = null;
    /** @type {Map<string, Walk>} */
    this.walks = new Map();
  }

  /**
   * Return the pose of each player, `phase` of the way from the previous state to `state`.
   * @param {State} state @param {State | null} before @param {number} step @param {number} phase
   */
  poses(state, before, step, phase) {
    const now = scene(state);
    if (state !== this.state || step !== this.step) {
      this.advance(state, now, before ? scene(before) : now, step);
    }
    /** @type {Map<string, Pose>} */
    const poses = new Map();
    for (const name of state.task.players) {
      const placed = now.get(name);
      if (!placed?.tile) continue;
      const walk = this.walks.get(name);
      const share = walk ? shareOf(walk, step, phase) : 1;
      if (!walk || share >= 1) {
        const facing = looking(placed.facing ?? [0, -1]);
        poses.set(name, { at: placed.tile, facing, walking: false, stride: 0 });
      } else {
        const [at, direction, stride] = along(walk.path, share);
        poses.set(name, { at, facing: looking(direction), walking: true, stride });
      }
    }
    return apart(poses);
  }

  /** @param {number} step The last step for which poses were computed. */
  walking(step) {
    return [...this.walks.values()].some((walk) => shareOf(walk, step) < 1);
  }

  /** @param {State} state @param {Scene} now @param {Scene} before @param {number} step */
  advance(state, now, before, step) {
    // After a jump to another step, walks in progress mean nothing.
    const follows = this.state === null || step === this.step || step === this.step + 1;
    const kept = follows ? this.walks : new Map();
    this.walks = new Map();
    for (const name of state.task.players) {
      let walk = kept.get(name);
      const here = before.get(name)?.tile;
      const there = now.get(name)?.tile;
      if (!here || !there) continue;
      if (walk && shareOf(walk, step) >= 1) walk = undefined;
      if (walk && sameTile(walk.path[walk.path.length - 1], there)) this.walks.set(name, walk);
      else if (!sameTile(here, there)) {
        // A new walk may begin before the old one has ended.
        const [x, y] = walk ? along(walk.path, shareOf(walk, step))[0] : here;
        const path = state.task.floor.path([Math.round(x), Math.round(y)], there);
        this.walks.set(name, { path, began: step, steps: state.busySteps(name) + 1 });
      }
    }
    this.state = state;
    this.step = step;
  }
}

/**
 * Place players that share a tile side by side, and let walkers pass each other. The rules let
 * players walk through each other. On the screen, each of two that come close steps aside: more,
 * the closer they are, and across the walk.
 * @param {Map<string, Pose>} poses
 */
function apart(poses) {
  const found = new Map(poses);
  const all = [...poses];
  for (const [name, pose] of all) {
    const sharing = all.filter(([, other]) => sameTile(other.at, pose.at));
    if (sharing.length < 2) continue;
    const gap = SIDE_BY_SIDE / (sharing.length - 1);
    const number = sharing.findIndex(([other]) => other === name);
    const at = /** @type {Point} */ ([pose.at[0] - SIDE_BY_SIDE / 2 + number * gap, pose.at[1]]);
    found.set(name, { ...pose, at });
  }
  all.forEach(([one, first], i) => {
    for (const [other, second] of all.slice(i + 1)) {
      if (sameTile(first.at, second.at) || !(first.walking || second.walking)) continue;
      const far = Math.hypot(second.at[0] - first.at[0], second.at[1] - first.at[1]);
      const aside = ASIDE * Math.max(0, 1 - far / CLOSE);
      const { facing } = first.walking ? first : second;
      const across = facing === "left" || facing === "right";
      for (const name of [one, other]) {
        const side = name === one ? -aside : aside;
        const pose = /** @type {Pose} */ (found.get(name));
        const [x, y] = pose.at;
        found.set(name, { ...pose, at: across ? [x, y - side] : [x + side, y] });
      }
    }
  });
  return found;
}

// Gestures

/**
 * Posture of a player at one moment.
 * @typedef {object} Gesture
 * @property {Side} facing
 * @property {"down" | "out" | "up"} arms
 * @property {number} lift Height above the ground, in tiles.
 * @property {number} squash 1 for a squat player, -1 for a stretched one, else 0.
 * @property {boolean} shut True while the eyes are shut.
 * @property {number} stride Number of the picture of its feet.
 */

/** Footsteps of a player on each tile. */
const STRIDES = 4;
/** Strokes of a tool in a step, and of the arms that hold it. */
export const BEATS = 2;
/** Seconds for which players cheer, or are disappointed, after the end of a game. */
export const CHEER_SECONDS = 2.2;
const STEP = 0.06;
const EFFORT = 0.03;
const JOY = 0.13;
const JUMPS = 2.4;
/** Seconds of a breath, and its heights in tiles. Few heights need few frames. */
const BREATH = 2.6;
const BREATHS = [0, 0.008, 0.016];
/** Seconds for which eyes are shut, and between two times; each player has its own rhythm. */
const BLINK = 0.13;
const AWAKE = 3.1;

/**
 * Return the gesture of each player.
 * @param {Map<string, Pose>} poses @param {Animation} animation
 * @param {{phase: number, seconds: number, since: number | null, outcome: string, still: boolean,
 *   held: Set<string>}} moment `since` is the time since the end of the game.
 * @returns {Map<string, Gesture>}
 */
export function gestures(poses, animation, moment) {
  const found = new Map();
  let number = 0;
  for (const [name, pose] of poses) {
    const gesture = gestureOf(pose, animation.working.has(name), number, moment);
    // The picture shows held objects on the side to which the player looks.
    const holds = moment.held.has(name) ? { arms: "out", facing: pose.facing } : {};
    found.set(name, { ...gesture, ...holds });
    number += 1;
  }
  return found;
}

/**
 * @param {Pose} pose @param {boolean} works @param {number} number
 * @param {{phase: number, seconds: number, since: number | null, outcome: string,
 *   still: boolean}} moment
 * @returns {Gesture}
 */
function gestureOf(pose, works, number, { phase, seconds, since, outcome, still }) {
  /** @type {Gesture} */
  const calm = { facing: pose.facing, arms: "down", lift: 0, squash: 0, shut: false, stride: 0 };
  if (still) return { ...calm, arms: works ? "out" : "down" };
  if (pose.walking) {
    const wave = Math.abs(Math.sin(((Math.PI * STRIDES) / 2) * pose.stride));
    const squash = wave > 0.7 ? -1 : wave < 0.25 ? 1 : 0;
    return { ...calm, lift: STEP * wave, squash, stride: Math.floor(pose.stride * STRIDES) };
  }
  if (works) {
    // The player turns to the viewer, and its arms go up and down.
    const wave = Math.sin(2 * Math.PI * BEATS * phase);
    const behind = pose.facing === "back";
    const arms = wave <= 0 ? "down" : behind ? "up" : "out";
    return { ...calm, arms, facing: behind ? "front" : pose.facing, lift: EFFORT * Math.abs(wave) };
  }
  if (since !== null && since < CHEER_SECONDS) {
    if (outcome === "won") {
      const wave = Math.abs(Math.sin(Math.PI * JUMPS * (since + number / 3)));
      const squash = wave > 0.8 ? -1 : wave < 0.2 ? 1 : 0;
      return { ...calm, facing: "front", arms: "up", lift: JOY * wave, squash };
    }
    if (outcome === "lost") return { ...calm, squash: 1, shut: true };
    return calm;
  }
  const level = (1 + Math.sin((2 * Math.PI * seconds) / BREATH + Math.PI * number)) / 2;
  const shut = (seconds + 1.7 * number) % (AWAKE + 0.7 * number) < BLINK;
  return { ...calm, lift: BREATHS[Math.round(level * (BREATHS.length - 1))], shut };
}

// Objects

/**
 * Everything that moves during a step.
 * @typedef {object} Animation
 * @property {Set<string>} travels Objects that a player takes, puts or pours.
 * @property {Set<string>} working Players who work.
 * @property {Set<string>} shaken Objects with which something goes on by itself.
 * @property {{effect: any, source: string}[]} emissions Particle effects.
 * @property {{tool: any, target: string}[]} tools
 */

/**
 * Return what moves between two moments, or at the first moment of a game.
 * @param {Look} look @param {State} state @param {State | null} before
 * @param {string} outcome Whether the game was `won` or `lost` with this step; else empty.
 * @returns {Animation}
 */
export function stepAnimation(look, state, before, outcome) {
  const stage = look.stage(state);
  const advanced = before ? advancedBetween(state, before) : [];
  const timed = state.progress().filter((row) => row.timed && row.running);
  const running = new Set(timed.map((row) => row.subject));
  const old = new Set(before?.progress().map((row) => row.subject));
  const subjects = advanced.map(([, subject]) => subject);
  if (before) subjects.push(...[...running].filter((name) => !old.has(name)));
  const places = new Set(subjects.map((subject) =>
    hostOf(stage, subject, (host) => stage.stations.has(host))));
  places.delete(null);
  /** @type {[string, string][]} */
  const goingOn = [
    ...timed.map((row) => /** @type {[string, string]} */ ([row.action, row.subject])),
    ...advanced,
  ];
  /** @type {[string | undefined, string][]} */
  const effects = goingOn.map(([action, subject]) => [look.during.get(action), subject]);
  for (const [name, { effects: own }] of stage.stations) {
    for (const effect of own) effects.push([effect, name]);
  }
  for (const { name, appearance } of [...stage.piles.values()].flat()) {
    for (const effect of appearance.effects) effects.push([effect, name]);
  }
  const moment = look.moments.get(outcome === "won" ? "goal" : outcome);
  for (const player of state.task.players) effects.push([moment, player]);
  return {
    travels: new Set(before ? travels(stage, look.stage(before)) : []),
    working: new Set(
      state.task.players.filter((name) => places.has(stage.placed.get(name)?.at ?? "")),
    ),
    shaken: running,
    emissions: effects.flatMap(([name, source]) => {
      const effect = name === undefined ? undefined : look.effects.get(name);
      return effect ? [{ effect, source }] : [];
    }),
    tools: goingOn.flatMap(([action, target]) => {
      const tool = look.tools.get(action);
      return tool ? [{ tool, target }] : [];
    }),
  };
}

/**
 * Return repeated actions that were done once more, each with its object.
 * @param {State} state @param {State} before @returns {[string, string][]}
 */
function advancedBetween(state, before) {
  const rows = (/** @type {State} */ each) =>
    new Map(
      each.progress().flatMap((row) =>
        row.timed ? [] : [[JSON.stringify([row.action, row.subject]), row.done]],
      ),
    );
  const then = rows(before);
  const now = rows(state);
  // Progress that appears or vanishes was advanced too: the first and the last repetition.
  return [...new Set([...then.keys(), ...now.keys()])]
    .filter((key) => (now.get(key) ?? Infinity) > (then.get(key) ?? -1))
    .map((key) => JSON.parse(/** @type {string} */ (key)))
    .sort();
}

/**
 * Yield objects that have a new carrier and were visible on the old one.
 * @param {SceneSprites} stage @param {SceneSprites} earlier
 */
function* travels(stage, earlier) {
  for (const [host, pieces] of stage.piles) {
    const there = new Set(earlier.piles.get(host)?.map((piece) => piece.name));
    for (const { name } of pieces) {
      if (!there.has(name) && earlier.placed.get(name)?.host) yield name;
    }
  }
}
