// One recording in pictures: the kitchen, speech bubbles, and notices.

import { Kitchen } from "../kitchen/painter.js";
import { Bubbles } from "../play/bubbles.js";
import { element, setText } from "../play/dom.js";
import { text } from "../play/texts.js";
import { pauseWords } from "./words.js";

/** @typedef {import("./player.js").Player} Player */
/** @typedef {import("./words.js").Words} Words */

// Seconds for which words stay over a player, and steps at least.
const [BUBBLE_SECONDS, BUBBLE_STEPS] = [3, 3];
const NOT_PRESENT = new Set(["", "absent", "substitute"]);

export class Run {
  /** @param {Words} words @param {any} look @param {Player} player */
  constructor(words, look, player) {
    const { reel } = words;
    this.reel = reel;
    this.words = words;
    this.player = player;
    this.canvas = element("canvas", { role: "img" });
    this.canvas.setAttribute("aria-label", text("kitchen", { count: reel.task.players.length }));
    this.notice = element("p", { class: "notice", hidden: true });
    this.over = element("div", { class: "bubbles", "aria-hidden": "true" });
    this.stage = element("div", { class: "stage" }, this.canvas, this.over, this.notice);
    this.kitchen = new Kitchen(this.canvas, reel.task, look);
    this.kitchen.fit();
    this.bubbles = new Bubbles(this.kitchen, this.over);
    this.step = -1;
    this.stage.addEventListener("click", () => player.play());
  }

  /** Show the step at the playhead. Return whether it is another one. @param {number} now */
  update(now) {
    const { reel, player, kitchen } = this;
    const step = player.stepOf(reel);
    if (step === this.step) return false;
    const before = player.advanced && step === this.step + 1 && step > 0;
    this.step = step;
    const cooks = reel.cooks(step);
    kitchen.seats = reel.task.players.map((name, seat) => ({
      player: name, name: cooks[seat].name, present: !NOT_PRESENT.has(cooks[seat].controller),
    }));
    this.showEvents(step);
    kitchen.show(reel.state(step), {
      step,
      before: before ? reel.state(step - 1) : null,
      stepSeconds: player.secondsOf(reel, step),
      receivedAt: now,
      outcome: step === reel.last ? reel.outcome : null,
    });
    return true;
  }

  /** Show the newest words of each player, and what happened between steps. @param {number} step */
  showEvents(step) {
    const { reel, kitchen } = this;
    const { players } = reel.task;
    const back = Math.max(BUBBLE_STEPS, Math.round(BUBBLE_SECONDS * this.player.rate));
    /** @type {Map<string, import("../play/bubbles.js").Said>} */
    const said = new Map();
    let notice = "";
    kitchen.rejected = new Set();
    for (let place = reel.eventsUntil(step - back); place < reel.eventsUntil(step); place += 1) {
      const entry = reel.log[place];
      const player = players[entry.seat];
      if (entry.kind === "said" && player) {
        const target = entry.rest[2] ? String(entry.rest[3] ?? "") : "";
        said.set(player, { words: this.words.said(entry), target });
      } else if ((entry.kind === "rejected" || entry.kind === "lost") && player) {
        if (entry.step === step) kitchen.rejected.add(player);
        const at = entry.kind === "lost" ? entry.step - 1 : entry.step;
        const words = this.words.reasons(entry.rest[1], at);
        if (entry.step <= step - BUBBLE_STEPS) continue;
        said.set(player, { words, rejected: true });
      } else if (entry.kind === "announced") {
        notice = this.words.entry(entry).what;
      } else if (entry.kind === "paused" && entry.step === step) {
        notice = pauseWords(entry.rest[0], entry.rest[1]);
      }
    }
    this.notice.hidden = !notice;
    setText(this.notice, notice);
    this.bubbles.showOnly(said);
    kitchen.pointing = this.bubbles.pointing;
  }

  /** @param {number} now Seconds. */
  draw(now) {
    this.kitchen.draw(now);
    this.bubbles.place(now);
  }
}
