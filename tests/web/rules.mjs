// Reads lines of `vectors.py` from standard input, and reports every answer in which the rules of
// the browser client differ. The last line of the output is a JSON object with the counts.
import { createInterface } from "node:readline";

const RULES = new URL("../../shared/robotouille/web/static/rules/", import.meta.url);
const load = (name) => import(new URL(`${name}.js`, RULES).href);
const [{ Task, atomName }, { State }, actions, work, { Controls, handled }, { Goal }, queues, { unserved }] = await Promise.all(
  ["task", "state", "actions", "work", "controls", "goal", "queue", "unserved"].map(load),
);

const MOST_SHOWN = 10;
const counts = { states: 0, answers: 0, differences: 0, milliseconds: 0, slowest: 0 };
const shown = [];

function same(a, b) {
  if (a === b) return true;
  if (typeof a !== "object" || typeof b !== "object" || !a || !b) return false;
  const [keys, others] = [Object.keys(a), Object.keys(b)];
  return keys.length === others.length && keys.every((key) => same(a[key], b[key]));
}

/** Compare an answer, unless the Python code has none. */
function check(name, found, expected) {
  if (expected === undefined) return;
  counts.answers += 1;
  if (same(found, expected)) return;
  counts.differences += 1;
  if (shown.length < MOST_SHOWN) shown.push({ state: counts.states, name, found, expected });
}

/** Compare each value of an object or list on its own, so that a difference is short. */
function checkEach(name, found, expected) {
  const keys = Object.keys(expected ?? {});
  if (expected === undefined) return;
  if (Object.keys(found).length !== keys.length) check(name, found, expected);
  else for (const key of keys) check(`${name}[${key}]`, found[key], expected[key]);
}

const rowOf = ({ action, hint, valid, advice }) => [action?.key ?? null, hint, valid, advice];
const keysOf = (list) => list.map(({ key }) => key);

function compare(game, state, expect) {
  const { me } = expect;
  check("facts", state.atoms().map(atomName).sort(), expect.facts);
  check("objects", [...state.objects.keys()], expect.objects);
  const { orders } = state;
  const row = orders && [
    orders.time, orders.open.map(({ number, due }) => [number, due]), orders.arrived,
    orders.score, orders.served, orders.expired,
  ];
  check("orders", row, expect.orders);
  checkEach("progress", state.progress(), expect.progress);
  for (const player of Object.keys(expect.actions ?? {})) {
    const found = keysOf(actions.validActions(state, player));
    check(`actions ${player}`, found, expect.actions[player]);
  }
  const { controls } = game;
  controls.names = new Map(Object.entries(expect.names));
  const wording = controls.wording(me);
  const valid = actions.validActions(state, me);
  check("useful", keysOf(work.usefulActions(state, me)), expect.useful);
  checkEach("work", work.workInProgress(state), expect.work);
  for (const { action, unmet, reasons, free } of expect.unmet ?? []) {
    const [name, ...args] = action;
    const tried = actions.actionNamed(state.task, name, args);
    const found = actions.unmet(state, tried);
    check(`unmet ${action}`, found, unmet.map(
      (each) => ({ predicate: "", objects: [], expected: true, ...each }),
    ));
    check(`reasons ${action}`, found.map((each) => wording.reason(each, state)), reasons);
    check(`free ${action}`, found.map((each) => wording.occupancy.neededFree(each)), free);
  }
  for (const [target, row] of Object.entries(expect.clicks ?? {})) {
    check(`click ${target}`, rowOf(controls.click(state, me, target)), row);
  }
  if (expect.keys) check("keys", controls.keys, Object.keys(expect.keys));
  for (const [key, row] of Object.entries(expect.keys ?? {})) {
    check(`key ${key}`, rowOf(controls.key(state, me, key)), row);
  }
  for (const [key, row] of Object.entries(expect.use ?? {})) {
    check(`use ${key}`, rowOf(controls.use(state, me, key)), row);
  }
  for (const [way, row] of expect.walks ?? []) {
    check(`walk ${way}`, rowOf(controls.walk(state, me, way)), row);
  }
  check("possible", keysOf(controls.possible(state, me)), expect.possible);
  const options = controls.options(state, me).map(({ key, action }) => [key, action.key]);
  check("options", options, expect.options);
  checkEach("hints", controls.hints(state, me, "E"), expect.hints);
  checkEach("handled", valid.map((each) => [...handled(state, me, each)].sort()), expect.handled);
  checkEach("ends_work", valid.map((each) => work.endsWork(state, each)), expect.ends_work);
  checkEach("does", valid.map((each) => wording.action(each, state)), expect.does);
  checkEach("things", expect.objects.map((name) => wording.thing(name, state)), expect.things);
  check("places", Object.fromEntries(wording.places(state)), expect.places);
  const general = state.task.schemas.map((each) => wording.inGeneral(each));
  checkEach("general", general, expect.general);
  check("purposes", wording.purposes(), expect.purposes);
  check("help", controls.help(), expect.help);
  checkEach("unserved", unserved(state, wording), expect.unserved);
  check("goal", game.goal.fit(state).holding, expect.goal);
}

const WAYS = { left: [-1, 0], right: [1, 0], up: [0, 1], down: [0, -1] };

/** Person who goes on with a game: a queue, and the actions that it has sent. */
function personOf({ controls }) {
  const person = { time: 0, sent: [] };
  const queue = new queues.ActionQueue({
    now: () => person.time,
    act: (action) => person.sent.push(action.key),
  });
  controls.names = new Map();
  return Object.assign(person, { queue });
}

function press({ queue, controls }, [kind, value], view) {
  if (kind === "click") return queue.click(controls, value, "left", view);
  if (kind === "walk") return queue.walk(controls, WAYS[value], value, view);
  if (kind === "use") return queue.use(controls, value, view);
  if (kind === "key") return queue.key(controls, value, view);
  if (kind === "tick") return queue.tick(view);
  if (kind === "release") {
    queue.release();
    return "";
  }
  if (kind === "step") {
    if (value !== null) queue.answered(value, view);
    return queue.tick(view);
  }
  const action = controls.possible(view.state, view.me)[value];
  const words = action && controls.wording(view.me).action(action, view.state);
  return action ? queue.pick(action, words, view) : "";
}

function comparePress({ person, controls }, line, state) {
  const view = { ...line.view, state, frozen: false, over: false };
  person.time = line.time;
  person.sent = [];
  const notice = press({ queue: person.queue, controls }, line.press, view);
  const { sent } = person.queue;
  const last = sent && [sent.action.key, sent.fate];
  check(`notice ${line.press}`, notice, line.notice);
  check(`queue ${line.press}`, { sent: person.sent, labels: person.queue.labels, last }, line.expect);
}

let game = null;
let state = null;
for await (const line of createInterface({ input: process.stdin })) {
  const read = JSON.parse(line);
  const { task, snapshot, delta, expect, bindings, language } = read;
  if (read.press) {
    if (read.after) state = state.after(read.after);
    game.person ??= personOf(game);
    comparePress(game, read, state);
    continue;
  }
  const begun = performance.now();
  if (task) {
    const made = new Task(task);
    game = { task: made, controls: new Controls(made, bindings, language), goal: new Goal(made) };
    state = State.fromSnapshot(made, snapshot);
  } else {
    state = state.after(delta);
    for (const player of game.task.players) actions.validActions(state, player);
    const spent = performance.now() - begun;
    counts.milliseconds += spent;
    counts.slowest = Math.max(counts.slowest, spent);
  }
  compare(game, state, expect);
  counts.states += 1;
}
for (const each of shown) console.log(JSON.stringify(each));
console.log(JSON.stringify(counts));
