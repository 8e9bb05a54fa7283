// Keyboard, mouse, touch and buttons of the person who plays.

import { Controls } from "../rules/controls.js";
import { ActionQueue } from "../rules/queue.js";
import { scene } from "../rules/scene.js";
import { unserved } from "../rules/unserved.js";
import { capitalised } from "../rules/words.js";
import { byId, element, inputById, now, setText } from "./dom.js";
import { duration, text, unservedWords } from "./texts.js";

/** @typedef {import("./game.js").Game} Game */
/** @typedef {import("./game.js").Answer} Answer */
/** @typedef {import("../kitchen/painter.js").Kitchen} Kitchen */
/** @typedef {import("../kitchen/look.js").Look} Look */
/** @typedef {import("../rules/actions.js").Action} Action */
/** @typedef {import("../rules/state.js").State} State */
/**
 * @typedef {{notify: (words: string) => void, signal: AbortSignal}} Around
 */

/** @type {Map<string, [number, number]>} Directions; y points up, as in problem files. */
const WALKS = new Map([
  ["w", [0, 1]], ["a", [-1, 0]], ["s", [0, -1]], ["d", [1, 0]],
  ["arrowup", [0, 1]], ["arrowleft", [-1, 0]], ["arrowdown", [0, -1]], ["arrowright", [1, 0]],
]);
const USE = ["e", " "];
const CHAT = ["t", "enter"];
const HELP = "h";
/** Signals in the order of their keys, 1 to 5. */
const SIGNALS = ["need", "yours", "look", "wait", "thanks"];
/** Signals that point at something. */
const POINTING = new Set(["need", "yours", "look"]);
/** Inputs that the help explains in general, not by the domain's actions. */
const KNOWN = new Set(["E", "Left click"]);
/** Mouse buttons by their numbers in events. @type {("left" | "middle" | "right")[]} */
const BUTTONS = ["left", "middle", "right"];

export class Hands {
  /** @param {Game} game @param {Kitchen} kitchen @param {Look} look @param {Around} around */
  constructor(game, kitchen, look, around) {
    this.game = game;
    this.kitchen = kitchen;
    this.around = around;
    const task = /** @type {import("../rules/task.js").Task} */ (game.task);
    this.controls = new Controls(task, look.bindings, look.rendering.language);
    this.queue = new ActionQueue({ now, act: (action) => game.act(action) });
    /** @type {string | null} The object that a pointer was on last, for signals. */
    this.pointed = null;
    /** @type {Map<string, HTMLLIElement>} Rows of the list by action. */
    this.rows = new Map();
    /** @type {unknown} The state whose actions are listed; null while none can be done. */
    this.listed = undefined;
    this.listen(around.signal);
    byId("choices").replaceChildren();
    this.drawSignals();
  }

  /** @param {AbortSignal} signal */
  listen(signal) {
    const canvas = byId("kitchen");
    canvas.addEventListener("pointermove", (event) => this.hover(event), { signal });
    canvas.addEventListener("pointerleave", () => this.hover(null), { signal });
    canvas.addEventListener("pointerdown", (event) => this.click(event), { signal });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
    document.addEventListener("keydown", (event) => this.key(event), { signal });
    document.addEventListener("keyup", (event) => this.release(event), { signal });
    addEventListener("blur", () => this.queue.release(), { signal });
    byId("help-button").addEventListener("click", () => this.help(), { signal });
    // The waiting room has the focus until the game begins.
    if (byId("cover").hidden) canvas.focus();
  }

  close() {
    this.queue.release();
    const dialog = /** @type {HTMLDialogElement} */ (byId("help"));
    if (dialog.open) dialog.close();
  }

  // What the rules need to know

  /** The moment as the queue sees it. */
  view() {
    const { game } = this;
    const { state, me, step, stepSeconds } = game;
    const frozen = !game.running || game.pause !== null;
    return { state, me, step, stepSeconds, frozen, over: game.outcome !== null };
  }

  // Events

  /** @param {PointerEvent | null} event */
  hover(event) {
    const found = event && this.kitchen.targetAt(event.offsetX, event.offsetY);
    this.kitchen.hover = found;
    if (found) this.pointed = found;
    const { state } = this.game;
    byId("kitchen").title = found && state ? this.tip(found) : "";
  }

  /** Return what a click on an object would do, and why a dish there is not served. @param {string} target */
  tip(target) {
    const { state, me } = this.game;
    if (!state) return "";
    const why = unserved(state, this.wording).filter(({ station }) => station === target);
    return [this.does(target, state, me), ...why.map(unservedWords)].join("\n");
  }

  /** @param {string} target @param {State} state @param {string | null} me */
  does(target, state, me) {
    const name = this.wording.thing(target, state);
    if (!me || state.busySteps(me)) return name;
    const { hint } = this.controls.click(state, me, target);
    return hint || name;
  }

  /** @param {PointerEvent} event */
  click(event) {
    byId("kitchen").focus();
    this.hover(event);
    const target = this.kitchen.targetAt(event.offsetX, event.offsetY);
    const button = BUTTONS[event.button];
    if (!target || !button || !this.game.me) return;
    const { state, me } = this.game;
    if (button === "middle") this.signal("look");
    else if (button === "right" && state && scene(state).get(me)?.at === target) this.use("");
    else this.around.notify(this.queue.click(this.controls, target, button, this.view()));
    if (event.pointerType !== "mouse") this.kitchen.hover = null;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return;
    const target = /** @type {HTMLElement} */ (event.target);
    const key = event.key.toLowerCase();
    if (target instanceof HTMLInputElement) {
      if (key === "escape") byId("kitchen").focus();
      return;
    }
    // A button that has the focus takes these keys itself.
    if (target instanceof HTMLButtonElement && (key === "enter" || key === " ")) return;
    if (this.moveInList(target, key)) {
      event.preventDefault();
      return;
    }
    if (/** @type {HTMLDialogElement} */ (byId("help")).open) return;
    if (this.command(key, event.repeat)) event.preventDefault();
  }

  /** Move the focus in the list of actions by the arrow keys. @param {Element} from @param {string} key */
  moveInList(from, key) {
    const way = new Map([["arrowleft", -1], ["arrowup", -1], ["arrowright", 1], ["arrowdown", 1]]);
    const rows = [...this.rows.values()];
    const at = rows.findIndex((row) => row.contains(from));
    const next = at < 0 ? undefined : rows[at + (way.get(key) ?? NaN)];
    if (next?.firstElementChild instanceof HTMLElement) next.firstElementChild.focus();
    return at >= 0 && way.has(key);
  }

  /** Run the command of a key; return whether there is one. @param {string} key @param {boolean} again */
  command(key, again) {
    const { controls, queue, game } = this;
    const name = key === " " ? "space" : key;
    const direction = WALKS.get(key);
    if (key === HELP) this.help();
    else if (CHAT.includes(key)) inputById("said").focus();
    else if (key === "escape") queue.clear();
    else if (game.me === null) return false;
    else if (USE.includes(key)) again || this.use(name);
    else if (controls.keys.includes(name)) again || this.around.notify(queue.key(controls, name, this.view()));
    else if (direction) again || this.around.notify(queue.walk(controls, direction, key, this.view()));
    else if (SIGNALS[Number(key) - 1]) again || this.signal(SIGNALS[Number(key) - 1]);
    else return false;
    return true;
  }

  /** @param {KeyboardEvent} event */
  release(event) {
    this.queue.release(event.key.toLowerCase());
  }

  /** Do the most useful thing here. @param {string} key */
  use(key) {
    this.around.notify(this.queue.use(this.controls, key, this.view()));
  }

  /** @param {string} intent */
  signal(intent) {
    const { pointed, game } = this;
    if (POINTING.has(intent) && (!pointed || pointed === game.me)) {
      this.around.notify(text("pointFirst"));
    } else {
      game.signal(intent, POINTING.has(intent) ? /** @type {string} */ (pointed) : "");
    }
  }

  // News of the game

  /** @param {Answer} answer */
  answered(answer) {
    const superseded = answer.why.some((each) => each.kind === "superseded");
    if (!superseded) this.queue.answered(answer.applied, this.view());
  }

  /** Send what is due, and mark the station of the last action, or the one waited for. */
  tick() {
    const { state, me } = this.game;
    if (!state || !me) return;
    this.around.notify(this.queue.tick(this.view()));
    const { sent, awaited } = this.queue;
    const station = sent ? sent.action.destination ?? scene(state).get(me)?.at : awaited;
    this.kitchen.mark = station ? { station, fate: sent?.fate ?? "asked" } : null;
  }

  /** Show who plays. */
  roster() {
    this.controls.names = new Map(this.game.seats.map(({ player, name }) => [player, name]));
    this.stepped();
  }

  /** The words of the kitchen for this reader. */
  get wording() {
    return this.controls.wording(this.game.me);
  }

  /** Show what can be done in the new state. */
  stepped() {
    const { game } = this;
    const { state, me } = game;
    const shown = game.running ? state : null;
    if (!state || !me || shown === this.listed) return;
    this.listed = shown;
    const busy = state.busySteps(me);
    this.hint(busy);
    // While the player is busy, the last list stays: a choice waits for its turn.
    if (busy && this.rows.size) return;
    this.list(game.running ? this.controls.possible(state, me) : []);
  }

  /** Show what the keys do now. @param {number} busy Steps until the player can act. */
  hint(busy) {
    const { state, me } = this.game;
    if (!state || !me) return;
    /** @type {[string, string][]} */
    let rows = [];
    if (busy) rows = [["", text("busy", { time: duration(busy, this.game.stepSeconds) })]];
    else if (this.game.running) rows = this.controls.hints(state, me, "E");
    // There is nothing to do here: newcomers need to know how to walk.
    if (this.game.running && !rows.length) {
      const touch = matchMedia("(pointer: coarse)").matches;
      rows = [touch ? [text("keyClick"), text("keyClickDoes")] : ["W A S D", text("keyWalk")]];
    }
    byId("hint").replaceChildren(...rows.map(([key, does]) =>
      element("span", {}, key && element("kbd", {}, key), key && " ", does)));
  }

  /** Show a list of actions, and leave rows that stay where they are. @param {Action[]} actions */
  list(actions) {
    const list = byId("choices");
    const { wording } = this;
    const { state } = this.game;
    if (!state) return;
    /** @type {Map<string, HTMLLIElement>} */
    const rows = new Map();
    for (const action of actions) {
      const words = this.controls.hintWords(
        { action, hint: capitalised(wording.action(action, state)), valid: true, advice: false },
        state,
      );
      const row = this.rows.get(action.key) ?? this.row();
      const button = /** @type {HTMLButtonElement} */ (row.firstElementChild);
      setText(button, words);
      button.onclick = (event) => {
        this.around.notify(this.queue.pick(action, words, this.view()));
        if (event.detail > 0) byId("kitchen").focus();
      };
      rows.set(action.key, row);
    }
    const focused = [...this.rows.values()].findIndex((row) => row.contains(document.activeElement));
    this.rows = rows;
    const wanted = [...rows.values()];
    if (wanted.some((row, i) => row !== list.children[i]) || wanted.length !== list.children.length) {
      list.replaceChildren(...wanted);
      // A list that changes under the focus keeps the place of the focus.
      const next = wanted[Math.min(focused, wanted.length - 1)]?.firstElementChild;
      if (focused >= 0 && next instanceof HTMLElement) next.focus();
    }
  }

  row() {
    return element("li", {}, element("button", { type: "button" }));
  }

  drawSignals() {
    const buttons = SIGNALS.map((intent, index) =>
      element(
        "button", { type: "button", title: String(index + 1), onclick: () => this.signal(intent) },
        text(intent),
      ));
    byId("signals").replaceChildren(...(this.game.seats.length > 1 ? buttons : []));
  }

  help() {
    /** @type {[string[], string][]} */
    const own = this.game.me === null ? [] : [
      [["W", "A", "S", "D"], text("keyWalk")],
      [["E"], text("keyUse")],
      [[text("keyClick")], text("keyClickDoes")],
      [["Tab"], text("keyActions")],
      [["1", "2", "3", "4", "5"], text("keySignals")],
      ...this.controls.help().filter(([key]) => !KNOWN.has(key))
        .map(([key, does]) => /** @type {[string[], string]} */ ([[key], does])),
    ];
    /** @type {[string[], string][]} */
    const rows = [...own, [["T"], text("keyChat")], [["H"], text("help")]];
    byId("keys").replaceChildren(...rows.flatMap(([keys, does]) => [
      element("dt", {}, ...keys.map((key) => element("kbd", {}, key))),
      element("dd", {}, does),
    ]));
    /** @type {HTMLDialogElement} */ (byId("help")).showModal();
  }
}
