// Events, activities and steps to go of a recording in words.

import { outcomeWords } from "../play/covers.js";
import { text } from "../play/texts.js";
import { filled } from "../rules/language.js";
import { Wording } from "../rules/words.js";

/** @typedef {import("./reel.js").Reel} Reel */
/** @typedef {import("./reel.js").Entry} Entry */

const ROSTER = new Map([
  ["joined", "joined"], ["left", "gone"], ["away", "away"], ["back", "back"], ["lost", "lost"],
  ["removed", "removed"],
]);

/** Words for the events of one recording. */
export class Words {
  /** @param {Reel} reel @param {any} language The `language` of a rendering file. */
  constructor(reel, language) {
    this.reel = reel;
    this.language = language;
    /** @type {{key: string, wording: Wording} | null} */
    this.lately = null;
  }

  /** Return the words of the kitchen, with the names of those who play. @param {number} step */
  wording(step) {
    const { task } = this.reel;
    const cooks = this.reel.cooks(step).map(({ name }) => name);
    const key = JSON.stringify(cooks);
    if (this.lately?.key !== key) {
      /** @type {[string, string][]} */
      const named = task.players.map((player, seat) => [player, cooks[seat]]);
      const names = new Map(named.filter(([, name]) => name));
      this.lately = { key, wording: new Wording(task, this.language, null, names) };
    }
    return this.lately.wording;
  }

  /** Return the name in a seat. @param {number} seat @param {number} step */
  name(seat, step) {
    return this.reel.cooks(step)[seat]?.name || this.reel.task.players[seat] || text("nobody");
  }

  /** Return an action in words. @param {number | string} action @param {number} step */
  action(action, step) {
    if (typeof action === "string") return action || text("hidden");
    const found = this.reel.action(action);
    if (!found) return this.reel.raw.actions[action].join(" ");
    return this.wording(step).action(found, this.reel.state(Math.max(0, step)));
  }

  /** @param {any[]} reasons @param {number} step */
  reasons(reasons, step) {
    const state = this.reel.state(Math.max(0, step));
    return reasons.map((/** @type {any} */ why) =>
      this.wording(step).reason({ predicate: "", objects: [], expected: true, ...why }, state),
    ).join("; ") || "–";
  }

  /** Return what a seat does in a step. @param {number} seat @param {number} step */
  doing(seat, step) {
    const action = this.reel.moves(step).get(seat);
    if (action !== undefined) return this.action(action, step - 1);
    return text(this.reel.activity(seat, step));
  }

  /** Return the text of a chat message or signal. @param {Entry} entry */
  said({ rest: [, words, intent, target], step }) {
    if (words || !intent) return String(words) || text("hidden");
    const wording = this.wording(step);
    const state = this.reel.state(step);
    const thing = state.thing(target) ? wording.place(target, state) : String(target);
    /** @type {any} */
    const templates = wording.language.signals;
    const template = Object.hasOwn(templates, intent) ? templates[intent] : intent;
    return filled(template, new Map([["thing", thing]]));
  }

  /** Return an event in words: who it is about, and what happened. @param {Entry} entry */
  entry(entry) {
    const { kind, seat, step, rest } = entry;
    const name = this.name(seat, step);
    const [first, second] = rest;
    switch (kind) {
      case "said": return { who: String(first) || text("someone"), what: this.said(entry) };
      case "thought": return { who: "", what: text("thought", { name, text: first }) };
      case "noted": return { who: "", what: text("noted", { name, text: first }) };
      case "rejected":
      case "lost": {
        const at = kind === "lost" ? step - 1 : step;
        const words = { name, action: this.action(first, at), reason: this.reasons(second, at) };
        return { who: "", what: text(kind === "lost" ? "wasLost" : "wasRejected", words) };
      }
      case "announced": {
        return { who: "", what: text("operator", { text: first || text("hidden") }) };
      }
      case "restarted": return { who: "", what: text("restarted") };
      case "paused": return { who: "", what: pauseWords(first, second) };
      case "ended": return { who: "", what: outcomeWords(this.reel.outcome) };
      default: {
        const what = text(ROSTER.get(kind) ?? "gone", { name: first });
        return { who: "", what: second ? text("bySubstitute", { what }) : what };
      }
    }
  }

  /** Return what is known about the steps to go. @param {number} step */
  toGo(step) {
    const row = this.reel.raw.to_go?.[step];
    if (!row) return "";
    const [least, most] = row;
    if (least < 0) return text("toGoNever");
    if (most === null) return least > 1 ? text("toGoLeast", { least }) : "";
    if (most === least) return text("toGoIs", { steps: most });
    return least > 1 ? text("toGoRange", { least, most }) : text("toGoMost", { most });
  }
}

/** @param {string[]} holds @param {number | null} seconds */
export function pauseWords(holds, seconds) {
  const words = seconds === null ? text("pausedOpen")
    : text("paused", { seconds: Math.max(1, Math.round(seconds)) });
  // After a restart nobody has come back yet, which needs no mention.
  const told = holds.filter((hold) => hold !== "deserted" || !holds.includes("restart"));
  return `${words}: ${told.map((hold) => text(`hold ${hold}`)).join(", ")}`;
}
