// A running kitchen in the operator's page, drawn from the states that the server sends.

import { Kitchen } from "../kitchen/painter.js";
import { loadLook } from "../play/look.js";
import { State } from "../rules/state.js";
import { Task } from "../rules/task.js";

/** @typedef {(what: string) => Promise<any>} Get Returns a part of the episode by its path. */

/** Milliseconds after which the page asks again for what it could not load. News come faster. */
const AGAIN = 5000;

export class LiveKitchen {
  /** @param {HTMLCanvasElement} canvas @param {Get} get */
  constructor(canvas, get) {
    this.canvas = canvas;
    this.get = get;
    /** @type {any} The newest news of the episode. */
    this.row = null;
    /** @type {any} The task, and the tables for reading its states. */
    this.tables = null;
    /** @type {State | null} */
    this.state = null;
    /** @type {Kitchen | null} */
    this.kitchen = null;
    this.loading = false;
    this.next = 0;
    this.closed = false;
  }

  /** Show an episode as it is now. @param {any} row */
  update(row) {
    this.row = row;
    if (this.kitchen && row.state.size <= this.tables.size) this.show();
    else if (!this.loading && !this.closed && performance.now() >= this.next) void this.load();
  }

  async load() {
    this.loading = true;
    try {
      this.tables = await this.get("kitchen");
      if (!this.kitchen) await this.furnish();
      this.canvas.hidden = false;
      if (!this.closed) this.show();
    } catch {
      // The rest of the panel works without a picture.
      this.canvas.hidden = true;
      this.next = performance.now() + AGAIN;
    }
    this.loading = false;
  }

  async furnish() {
    const task = new Task(this.tables.task);
    const look = await loadLook(task, this.tables.look, async ({ digest }) =>
      ({ type: "picture", ...await this.get(`pictures/${digest}`) }));
    if (this.closed) return;
    this.kitchen = new Kitchen(this.canvas, task, look);
    this.kitchen.fit();
    const frame = () => {
      if (this.closed) return;
      this.kitchen?.draw(performance.now() / 1000);
      requestAnimationFrame(frame);
    };
    frame();
  }

  show() {
    const { kitchen, tables, row, state } = this;
    const { step, outcome, seats, step_rate: rate } = row;
    if (!kitchen) return;
    // People also come and go in a paused game.
    kitchen.seats = seats;
    if (state?.step === step && !outcome) return;
    this.state = State.fromSnapshot(kitchen.task, { ...tables, ...row.state, step });
    kitchen.show(this.state, {
      step,
      // Fast games show some of their steps only.
      before: state?.step === step - 1 ? state : null,
      stepSeconds: rate ? 1 / rate : null,
      receivedAt: performance.now() / 1000,
      outcome: outcome && { ...outcome, score: { points: this.state.orders?.score ?? 0 } },
    });
  }

  close() {
    this.closed = true;
    this.kitchen?.close();
  }
}
