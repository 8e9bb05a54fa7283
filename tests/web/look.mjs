// Reads lines of `test_look.py` from standard input, and reports every state that the browser
// client would show otherwise than the window. The last line of the output has the counts.
import { createInterface } from "node:readline";

const STATIC = new URL("../../shared/robotouille/web/static/", import.meta.url);
const load = (name) => import(new URL(`${name}.js`, STATIC).href);
const [{ Task }, { State }, { scene }, { Look }, wanted, motion] = await Promise.all(
  ["rules/task", "rules/state", "rules/scene", "kitchen/look", "kitchen/dishes", "kitchen/motion"]
    .map(load),
);

const MOST_SHOWN = 10;
const counts = { states: 0, answers: 0, differences: 0 };
const shown = [];

function same(a, b) {
  if (typeof a === "number" && typeof b === "number") return Math.abs(a - b) < 1e-9;
  if (typeof a !== "object" || typeof b !== "object" || !a || !b) return a === b;
  const [keys, others] = [Object.keys(a), Object.keys(b)];
  return keys.length === others.length && keys.every((key) => key in b && same(a[key], b[key]));
}

function check(name, found, expected) {
  counts.answers += 1;
  // As JSON, so that lists and objects compare by their values.
  const plain = JSON.parse(JSON.stringify(found));
  if (same(plain, expected)) return;
  counts.differences += 1;
  if (shown.length < MOST_SHOWN) shown.push({ state: counts.states, name, found: plain, expected });
}

const sorted = (values) => [...values].sort();
const byName = (map, row) => Object.fromEntries([...map].map(([key, each]) => [key, row(each)]));

function sceneRows(state) {
  return byName(scene(state), ({ tile, host, level, facing, at, facts, contents }) => ({
    tile, host, level, facing, at, facts: sorted(facts), contents,
  }));
}

function stageRows(stage) {
  return {
    stations: byName(stage.stations, (each) => each),
    piles: byName(stage.piles, (each) => each),
    bases: byName(stage.bases, (each) => each),
  };
}

function dishRows(found) {
  return found && found.map(({ layers }) => layers);
}

let game = null;
for await (const line of createInterface({ input: process.stdin })) {
  const { task, look, snapshot, delta, step, expect } = JSON.parse(line);
  if (task) {
    const own = new Task(task);
    game = {
      task: own, before: null, state: State.fromSnapshot(own, snapshot), motion: new motion.Motion(),
      look: new Look({ ...look, pictures: new Map() }), effects: Object.entries(look.rendering.effects ?? {}),
    };
    check("dishes", dishRows(wanted.dishes(own, game.look)), expect.dishes);
    for (const [name, appearances] of Object.entries(expect.orders)) {
      check(name, wanted.orderLayers(own, game.look, name).map((each) => each.appearance), appearances);
    }
  } else {
    [game.before, game.state] = [game.state, game.state.after(delta)];
  }
  const { state, before } = game;
  check("scene", sceneRows(state), expect.scene);
  const stage = game.look.stage(state);
  check("stage", stageRows(stage), expect.stage);
  check("words", byName(stage.placed, (each) => game.look.words(each.thing.kind, each.facts)), expect.words);
  const animation = motion.stepAnimation(game.look, state, before, expect.outcome);
  check("animation", {
    travels: sorted(animation.travels),
    working: sorted(animation.working),
    shaken: sorted(animation.shaken),
    emissions: animation.emissions.map(({ effect, source }) => [effect.asset, source]),
    tools: animation.tools.map(({ tool, target }) => [tool.asset, target]),
  }, expect.animation);
  const held = new Set([...stage.piles.keys()]);
  for (const { phase, seconds, poses, gestures, walking } of expect.poses) {
    const found = game.motion.poses(state, before, step, phase);
    check("poses", byName(found, (each) => each), poses);
    check("walking", game.motion.walking(step), walking);
    const moment = { phase, seconds, since: null, outcome: "", still: false, held };
    check("gestures", byName(motion.gestures(found, animation, moment), (each) => each), gestures);
  }
  counts.states += 1;
}
for (const each of shown) console.log(JSON.stringify(each));
console.log(JSON.stringify(counts));
