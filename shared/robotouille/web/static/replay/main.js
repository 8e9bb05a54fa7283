// The page for recordings: shows one, or two of the same task side by side.

import { Look } from "../kitchen/look.js";
import { outcomeWords } from "../play/covers.js";
import { byId, element, setText } from "../play/dom.js";
import { clock, text } from "../play/texts.js";
import { Task } from "../rules/task.js";
import { taskTitle } from "../rules/words.js";
import { Coding } from "./coding.js";
import { fillHelp } from "./help.js";
import { Panel } from "./panel.js";
import { Player, SPEEDS } from "./player.js";
import { Reel } from "./reel.js";
import { Run } from "./run.js";
import { chooseTexts } from "./texts.js";
import { MARKS, Timeline } from "./timeline.js";
import { Words } from "./words.js";

const FORMAT = 1;
// The live region speaks when the playhead has rested for this time.
const SPOKEN_MS = 400;
const ICONS = {
  first: "M4 4h3v14H4zM18 4v14L8 11z", mark1: "M20 4v14l-8-7zM11 4v14l-8-7z",
  back1: "M16 4v14L5 11z", play: "M6 3v16l13-8z", pause: "M5 4h4v14H5zM13 4h4v14h-4z",
  on1: "M6 4v14l11-7z", mark2: "M2 4v14l8-7zM11 4v14l8-7z", last: "M4 4v14l10-7zM15 4h3v14h-3z",
};

/** @typedef {keyof typeof ICONS} Icon */

/** @param {string} name */
const path = (name) => document.createElementNS("http://www.w3.org/2000/svg", name);

/** @param {Icon} name */
function icon(name) {
  const svg = path("svg");
  svg.setAttribute("viewBox", "0 0 22 22");
  svg.setAttribute("aria-hidden", "true");
  const shape = path("path");
  shape.setAttribute("d", ICONS[name]);
  svg.append(shape);
  return svg;
}

/** Everything on the page. */
class Page {
  /** @param {any} data */
  constructor(data) {
    const task = new Task(data.task);
    const { rendering, bindings, pictures } = data.look;
    this.look = new Look({ rendering, bindings, pictures: new Map(Object.entries(pictures)) });
    this.data = data;
    /** @type {Reel[]} */
    this.reels = data.recordings.map((/** @type {any} */ raw) => new Reel(task, raw));
    this.words = this.reels.map((reel) => new Words(reel, rendering.language));
    this.changed = true;
    this.player = new Player(this.reels, () => (this.changed = true));
    this.runs = this.words.map((words) => new Run(words, this.look, this.player));
    this.panels = this.words.map((words) => new Panel(words, this.look, (step, ms) =>
      this.goTo(words.reel, step, ms)));
    this.side = 0;
    this.timeline = new Timeline(byId("lanes"), this.player, this.words);
    /** @type {Map<string, HTMLButtonElement>} */
    this.buttons = new Map();
    this.position = element("p", { id: "position" });
    this.left = element("p", { id: "left", class: "faint" });
    this.speed = element("select", { id: "speed" }, ...SPEEDS.map((speed) =>
      element("option", { value: String(speed) }, `×${speed}`)));
    this.spoken = 0;
    /** @type {number | undefined} Milliseconds until the first picture. */
    this.readyAt = undefined;
    this.coding = data.codebook ? this.code(data.codebook.labels) : null;
    this.place();
    fillHelp();
    this.listen();
  }

  /** Put everything in its place. */
  place() {
    const { reels, runs } = this;
    const two = reels.length > 1;
    const title = taskTitle(reels[0].task.name);
    setText(byId("title"), title);
    document.title = `${title} – Robotouille`;
    setText(byId("outcome"), two ? "" : this.ending(0));
    byId("runs").replaceChildren(...runs.map((run, number) => element(
      "section", { class: "run" },
      two && element("h2", {}, `${this.label(number)} `,
        element("span", { class: "faint" }, this.ending(number))),
      run.stage,
    )));
    /** @type {[Icon, () => void][]} */
    const actions = [
      ["first", () => this.player.seek(0)], ["mark1", () => this.event(-1)],
      ["back1", () => this.player.move(-1)], ["play", () => this.player.play()],
      ["on1", () => this.player.move(1)], ["mark2", () => this.event(1)],
      ["last", () => this.player.seek(this.player.end)],
    ];
    for (const [name, onclick] of actions) {
      const button = element("button", { type: "button", class: name, onclick }, icon(name));
      button.setAttribute("aria-label", text(name));
      button.title = text(name);
      this.buttons.set(name, button);
    }
    this.speed.setAttribute("aria-label", text("speed"));
    this.speed.addEventListener("change", () => {
      this.player.speed = Number(this.speed.value);
      this.changed = true;
    });
    const keys = element("div", { class: "keys" }, ...this.buttons.values());
    byId("buttons").replaceChildren(this.position, keys, this.speed, this.left);
    this.choices(byId("sync"), text("sync"), [text("inStep"), text("inTime")], (chosen) => {
      this.player.count(chosen === 1);
      this.timeline.draw();
    });
    const sides = reels.map((_, number) => text("recording", { number: number + 1 }));
    this.choices(byId("sides"), text("sync"), sides, (chosen) => this.turn(chosen));
    this.turn(0);
    if (!this.data.anonymous) return;
    byId("panel").append(element("p", { class: "faint" }, text("anonymous")));
  }

  /** Let the reader give labels to steps. @param {import("./coding.js").Label[]} labels */
  code(labels) {
    const coding = new Coding(labels, this.words[0], {
      step: () => this.player.stepOf(this.reels[0]),
      go: (step) => this.goTo(this.reels[0], step, 0),
      changed: () => {
        this.timeline.spans = coding.spans;
        this.timeline.draw();
      },
    });
    byId("panel").prepend(coding.root);
    return coding;
  }

  /** @param {number} number */
  label(number) {
    const { label } = this.reels[number];
    return label ? `${number + 1} · ${label}` : text("recording", { number: number + 1 });
  }

  /** Return how a recording ends. @param {number} number */
  ending(number) {
    const { outcome, raw } = this.reels[number];
    if (raw.fault) return text("damaged", { fault: raw.fault });
    return outcome ? outcomeWords(outcome) : text("noEnd");
  }

  /**
   * Let the reader choose one of several, if there are two recordings.
   * @param {HTMLElement} root @param {string} label @param {string[]} names
   * @param {(chosen: number) => void} choose
   */
  choices(root, label, names, choose) {
    root.hidden = this.reels.length < 2;
    root.setAttribute("aria-label", label);
    const press = (/** @type {number} */ number) => buttons.forEach((each, place) =>
      each.setAttribute("aria-pressed", String(place === number)));
    const buttons = names.map((name, number) => element("button", {
      type: "button",
      onclick: () => {
        press(number);
        choose(number);
      },
    }, name));
    press(0);
    root.replaceChildren(...buttons);
  }

  /** Show another recording beside the kitchens. @param {number} side */
  turn(side) {
    this.side = side;
    const panel = this.panels[side];
    byId("tickets").replaceChildren(panel.ticketRoot);
    byId("seats").replaceChildren(panel.cooks);
    byId("talk").replaceChildren(panel.events);
    panel.shown = "";
    panel.update(Math.max(0, this.player.stepOf(this.reels[side])));
  }

  /** @param {Reel} reel @param {number} step @param {number} ms */
  goTo(reel, step, ms) {
    this.player.playing = false;
    this.player.seek(this.player.inTime ? Math.max(ms, reel.times[step]) : step);
  }

  /** Go to the next event, or to the previous one. @param {1 | -1} way */
  event(way) {
    const { player } = this;
    const steps = this.reels.flatMap((reel) => reel.log
      .filter(({ kind }) => MARKS.has(kind)).map(({ step }) => player.placeOf(reel, step)));
    const here = player.inTime ? player.at : Math.floor(player.at);
    const found = steps.filter((at) => (at - here) * way > 0);
    player.playing = false;
    player.seek(way > 0 ? Math.min(player.end, ...found) : Math.max(0, ...found));
  }

  listen() {
    const { player } = this;
    /** @type {Map<string, (event: KeyboardEvent) => void>} */
    const keys = new Map(/** @type {[string, (event: KeyboardEvent) => void][]} */ ([
      [" ", () => player.play()],
      ["ArrowLeft", ({ shiftKey }) => player.move(shiftKey ? -10 : -1)],
      ["ArrowRight", ({ shiftKey }) => player.move(shiftKey ? 10 : 1)],
      ["PageUp", () => player.move(-10)], ["PageDown", () => player.move(10)],
      ["Home", () => player.seek(0)], ["End", () => player.seek(player.end)],
      [",", () => this.event(-1)], [".", () => this.event(1)],
      ["+", () => player.faster(1)], ["-", () => player.faster(-1)],
    ]));
    addEventListener("keydown", (event) => {
      const target = /** @type {HTMLElement} */ (event.target);
      const does = keys.get(event.key);
      // Space presses the focused button, and arrows choose the speed or scroll the goal.
      const taking = event.key === " " ? "button, select, dialog, input"
        : "select, dialog, input, #tickets";
      if (target.closest(taking) || event.ctrlKey || event.metaKey || event.altKey) return;
      if (does) does(event);
      if (does || this.coding?.press(event.key, event.shiftKey)) event.preventDefault();
    });
  }

  /** @param {number} now Seconds. */
  frame(now) {
    this.player.tick(now);
    if (this.changed) {
      this.changed = false;
      for (const run of this.runs) run.update(now);
      this.panels[this.side].update(this.runs[this.side].step);
      this.timeline.update();
      this.status();
    }
    const panel = this.panels[this.side];
    if (!panel.shown) panel.showLines(this.runs[this.side].step);
    for (const run of this.runs) run.draw(now);
  }

  status() {
    const { player } = this;
    const reel = player.longest;
    const step = player.stepOf(reel);
    const words = text("step", { step, last: reel.last });
    setText(this.position, `${words} · ${clock(reel.times[step] / 1000)}`);
    setText(this.left, this.words[this.side].toGo(this.runs[this.side].step));
    this.speed.value = String(player.speed);
    const name = player.playing ? "pause" : "play";
    const button = this.buttons.get("play");
    if (button && button.getAttribute("aria-label") !== text(name)) {
      button.replaceChildren(icon(name));
      button.setAttribute("aria-label", text(name));
      button.title = text(name);
    }
    clearTimeout(this.spoken);
    if (!player.playing) {
      const speak = () => setText(byId("live"), `${words}. ${this.spokenWords()}`);
      this.spoken = setTimeout(speak, SPOKEN_MS);
    }
  }

  /** Return what the cooks do, for a screen reader. */
  spokenWords() {
    const { reel, words, step } = this.runs[this.side];
    return reel.task.players.map((_, seat) =>
      `${words.name(seat, step)}: ${words.doing(seat, step)}`).join(". ");
  }
}

/** Show the recordings. @param {any} data The value of `page_data` in Python. */
export async function start(data) {
  chooseTexts();
  if (data.format !== FORMAT) throw new Error(`format ${data.format}`);
  byId("replay").hidden = false;
  const page = new Page(data);
  // Programs, such as tests, can read what is shown.
  Object.assign(globalThis, { robotouille: page });
  await Promise.all(page.runs.map((run) => run.kitchen.ready));
  const frame = (/** @type {number} */ ms) => {
    try {
      page.frame(ms / 1000);
    } catch (error) {
      byId("message").hidden = false;
      setText(byId("message"), String(error));
      throw error;
    }
    page.readyAt ??= performance.now();
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}
