// Speech bubbles over the cooks, and reasons why an action did not work.

import { byId, element, now } from "./dom.js";
import { pictureURL } from "../kitchen/pictures.js";

/** @typedef {import("../kitchen/painter.js").Kitchen} Kitchen */
/** @typedef {import("../kitchen/look.js").Look} Look */
/** @typedef {import("../rules/words.js").Wording} Wording */

const SECONDS = 4;
const MAX_LETTERS = 120;

/**
 * Return a bubble with words, and the picture of what they point at.
 * @param {Kitchen} kitchen @param {Look} look
 * @param {{words: string, rejected: boolean, target: string}} said
 */
export function bubble(kitchen, look, { words, rejected, target }) {
  const cut = words.length > MAX_LETTERS ? `${words.slice(0, MAX_LETTERS)}…` : words;
  const box = element("div", { class: rejected ? "bubble rejected" : "bubble" }, cut);
  const appearance = target && kitchen.shown ? kitchen.appearanceOf(target) : null;
  if (appearance) box.append(" ", element("img", { src: pictureURL(look, appearance), alt: "" }));
  return box;
}

/**
 * Place a bubble over a player, inside the kitchen.
 * @param {HTMLElement} box @param {{x: number, y: number, tile: number}} spot
 */
export function placeOver(box, { x, y, tile }) {
  const half = box.offsetWidth / 2 + 4;
  const room = box.parentElement?.clientWidth ?? 0;
  box.style.left = `${Math.min(Math.max(x, half), room - half)}px`;
  box.style.top = `${Math.max(y - tile * 0.75, box.offsetHeight + 4)}px`;
}

export class Bubbles {
  /** @param {Kitchen} kitchen @param {Look} look @param {() => Wording} wording */
  constructor(kitchen, look, wording) {
    this.kitchen = kitchen;
    this.look = look;
    this.wording = wording;
    this.root = byId("bubbles");
    /** @type {Map<string, {box: HTMLElement, until: number, rejected: boolean, target: string}>} */
    this.shown = new Map();
  }

  /** Players whose last action was rejected. */
  get rejected() {
    return new Set([...this.shown].filter(([, each]) => each.rejected).map(([player]) => player));
  }

  /** What the shown signals point at. */
  get pointing() {
    return [...this.shown].flatMap(([player, { target }]) => (target ? [{ player, target }] : []));
  }

  /**
   * Show words over a player.
   * @param {string} player @param {string} words @param {{rejected?: boolean, target?: string}} [how]
   */
  show(player, words, { rejected = false, target = "" } = {}) {
    this.shown.get(player)?.box.remove();
    const box = bubble(this.kitchen, this.look, { words, rejected, target });
    this.root.append(box);
    this.shown.set(player, { box, until: now() + SECONDS, rejected, target });
  }

  /** Show a chat message or signal. @param {import("./game.js").Line} line */
  say(line) {
    this.show(line.seat, line.text, { target: line.intent ? line.target : "" });
  }

  /** Move the bubbles with their players. @param {number} at */
  place(at) {
    for (const [player, { box, until }] of this.shown) {
      const spot = this.kitchen.spotOf(player);
      if (at > until || !spot) {
        box.remove();
        this.shown.delete(player);
        continue;
      }
      placeOver(box, spot);
    }
  }

  close() {
    for (const { box } of this.shown.values()) box.remove();
    this.shown.clear();
  }
}
