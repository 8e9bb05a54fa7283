// Speech bubbles over the cooks, and reasons why an action did not work.

import { element, now } from "./dom.js";
import { pictureURL } from "../kitchen/pictures.js";

/** @typedef {import("../kitchen/painter.js").Kitchen} Kitchen */
/**
 * @typedef {{words: string, rejected?: boolean, target?: string}} Said Words over a player, and
 *   the object that they point at.
 */

const SECONDS = 4;
const MAX_LETTERS = 120;

export class Bubbles {
  /** @param {Kitchen} kitchen @param {HTMLElement} root */
  constructor(kitchen, root) {
    this.kitchen = kitchen;
    this.root = root;
    /** @type {Map<string, {box: HTMLElement, until: number, said: Said}>} */
    this.shown = new Map();
  }

  /** Players whose last action was rejected. */
  get rejected() {
    return new Set([...this.shown].filter(([, { said }]) => said.rejected).map(([player]) => player));
  }

  /** What the shown signals point at. */
  get pointing() {
    return [...this.shown].flatMap(([player, { said: { target } }]) =>
      target ? [{ player, target }] : []);
  }

  /** Show words over a player until a time. @param {string} player @param {Said} said */
  show(player, said, until = now() + SECONDS) {
    this.remove(player);
    const { words, rejected, target } = said;
    const cut = words.length > MAX_LETTERS ? `${words.slice(0, MAX_LETTERS)}…` : words;
    const box = element("div", { class: rejected ? "bubble rejected" : "bubble" }, cut);
    const { kitchen } = this;
    const appearance = target ? kitchen.appearanceOf(target) : null;
    if (appearance) {
      box.append(" ", element("img", { src: pictureURL(kitchen.look, appearance), alt: "" }));
    }
    this.root.append(box);
    this.shown.set(player, { box, until, said });
  }

  /** Show these words and no others, until they are replaced. @param {Map<string, Said>} all */
  showOnly(all) {
    for (const [player, { said }] of this.shown) {
      if (all.get(player)?.words !== said.words) this.remove(player);
    }
    for (const [player, said] of all) {
      if (!this.shown.has(player)) this.show(player, said, Infinity);
    }
  }

  /** @param {string} player */
  remove(player) {
    this.shown.get(player)?.box.remove();
    this.shown.delete(player);
  }

  /** Move the bubbles with their players, inside the kitchen. @param {number} at */
  place(at) {
    for (const [player, { box, until }] of this.shown) {
      const spot = this.kitchen.spotOf(player);
      box.hidden = !spot;
      if (at > until) this.remove(player);
      else if (spot) {
        const half = box.offsetWidth / 2 + 4;
        const x = Math.min(Math.max(spot.x, half), this.root.clientWidth - half);
        box.style.left = `${x}px`;
        box.style.top = `${Math.max(spot.y - spot.tile * 0.75, box.offsetHeight + 4)}px`;
      }
    }
  }
}
