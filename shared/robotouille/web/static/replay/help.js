// The dialog that explains the keys and the signs of the timeline.

import { byId, element } from "../play/dom.js";
import { text } from "../play/texts.js";
import { ACTIVITIES, MARKS, drawMark } from "./timeline.js";

const KEYS = [
  ["Space", "keySpace"], ["← →", "keyArrows"], [", .", "keyEvents"], ["− +", "keySpeed"],
  ["Home End", "keyEnds"],
];
const SIGNS = [
  ["said", "said"], ["rejected", "rejectedSign"], ["thought", "thoughtSign"],
  ["announced", "announcedSign"], ["paused", "pauseSign"], ["restarted", "restartSign"],
  ["ended", "endSign"],
];

export function fillHelp() {
  const dialog = /** @type {HTMLDialogElement} */ (byId("help"));
  byId("keys").replaceChildren(...KEYS.flatMap(([key, words]) =>
    [element("dt", {}, element("kbd", {}, key)), element("dd", {}, text(words))]));
  const lanes = [...ACTIVITIES].map(([letter, [colour, height]]) =>
    legend(text(letter), (context) => {
      context.fillStyle = colour;
      context.fillRect(3, 15 - 14 * height, 10, 14 * height);
    }));
  const signs = SIGNS.map(([kind, words]) => legend(text(words), (context) => {
    drawMark(context, /** @type {[string, string]} */ (MARKS.get(kind)), 8, 2, 12);
  }));
  byId("signs").replaceChildren(...lanes, ...signs);
  byId("help-button").addEventListener("click", () => dialog.showModal());
}

/** @param {string} words @param {(context: CanvasRenderingContext2D) => void} draw */
function legend(words, draw) {
  const canvas = element("canvas", { width: 32, height: 32, "aria-hidden": "true" });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.scale(2, 2);
  draw(context);
  return element("li", {}, canvas, words);
}
