/**
 * Queue of the local player's inputs: one action is sent, the others wait.
 *
 * @typedef {import("./state.js").State} State
 * @typedef {import("./actions.js").Action} Action
 * @typedef {import("./actions.js").Unmet} Unmet
 * @typedef {import("./controls.js").Controls} Controls
 * @typedef {import("./controls.js").Resolved} Resolved
 * @typedef {import("./floor.js").Tile} Tile
 * @typedef {{
 *   state: State | null, me: string | null, stepSeconds?: number | null, frozen: boolean,
 *   over: boolean,
 * }} View Moment of a game. `stepSeconds` is null if the clock waits for decisions. A `frozen` game
 *   accepts no actions now.
 * @typedef {{
 *   label: string, resolve: (state: State, me: string, view: View) => Resolved, follows?: boolean,
 *   action?: Action, controls?: Controls, directions?: Tile[],
 * }} Intent Input that is resolved to an action when its turn comes. It `follows` if it is meant
 *   for the station that the walk before it leads to.
 * @typedef {"asked" | "done" | "rejected"} Fate
 * @typedef {{
 *   action: Action, time: number, fate: Fate, state: State | null, handled: Set<string>,
 * }} Sent The last action that was sent, with the time in seconds when it was sent, or when its
 *   result was known, the state in which it was sent, and what it takes up or puts down: nothing
 *   if it is work such as cutting.
 * @typedef {{label: string, action: Action, until: number}} Retry Walk to an occupied station that
 *   is repeated until a time.
 */
import { changes, unmet, validActions } from "./actions.js";
import { handled, isIdle, keyWords, takesApart, WAIT } from "./controls.js";
import { capitalised } from "./words.js";
import { preparationOf } from "./work.js";

/** Time for which a direction must be held to walk again. */
const REPEAT_SECONDS = 0.35;
const MAX_QUEUED = 3;
/** Largest number of directions that become one walk. */
const MAX_DIRECTIONS = 6;
/** Time after an action during which an input is queued. A later input replaces the action. */
const QUICK_SECONDS = 0.4;
/** Time for which the result of an action is marked. */
const SHOWN_SECONDS = 0.5;
/** Time in which the use key does not take up or put down what the last action was about. */
const GUARD_SECONDS = 1.0;
/** Time between two presses of the use key that take a dish apart together. */
const CONFIRM_SECONDS = 3.0;
const PART_OF_DISH = "this is part of a dish; press again to take it off";
const GUARDED = "done; to move it again, wait a second or click";
/**
 * Time for which a walk to an occupied station is retried. Cutting takes about three seconds, after
 * which most players leave.
 */
const PATIENCE_SECONDS = 6.0;
/** Notice for an action that was meant for the end of a walk that failed. */
const UNREACHED = "You didn't get there, so nothing was done";
/** Notice for a walk to a station that did not become free in time. */
const STILL_OCCUPIED = "It is still occupied, so you stopped waiting for it";

export class ActionQueue {
  /** @param {{now: () => number, act: (action: Action) => void}} game */
  constructor(game) {
    this._game = game;
    /** @type {Intent[]} */
    this._waiting = [];
    /** @type {Sent | null} */
    this._sent = null;
    this._label = "";
    /** @type {Retry | null} */
    this._retry = null;
    /** @type {number | null} When a walk failed. */
    this._failedAt = null;
    this._untold = "";
    /** @type {number | null} When the use key was pressed last. */
    this._usedAt = null;
    /**
     * @type {{key: string, time: number} | null} Action that takes a dish apart and awaits a second
     *   press, and when it was declined.
     */
    this._apart = null;
    this._tickedAt = game.now();
    /** @type {{key: string, since: number, intent: Intent} | null} The direction that is held. */
    this._held = null;
  }

  // Inputs. Each method returns a notice for the player, or "".

  /**
   * Handle a click on an object.
   * @param {Controls} controls @param {string} target @param {string} button @param {View} view
   */
  click(controls, target, button, view) {
    if (!view.state) return "";
    const label = controls.wording(view.me).place(target, view.state);
    /** @type {Intent["resolve"]} */
    const resolve = (state, me) => controls.click(state, me, target, button);
    return this.ask({ label, resolve }, view);
  }

  /**
   * Handle a key of the domain's input file.
   * @param {Controls} controls @param {string} key @param {View} view
   */
  key(controls, key, view) {
    const follows = controls.isForPlaces(key);
    /** @type {Intent["resolve"]} */
    const resolve = (state, me) => controls.key(state, me, key);
    return this.ask({ label: keyWords(key), resolve, follows }, view);
  }

  /**
   * Handle the use key, which does the most useful action here.
   * @param {Controls} controls @param {string} key @param {View} view
   */
  use(controls, key, view) {
    const follows = !controls.keys.includes(key) || controls.isForPlaces(key);
    // The action is chosen when its turn comes, because the state may change until then.
    const presses = { repeats: this._repeatsUse, confirmed: this._confirmed };
    this._apart = null;
    this._usedAt = this._game.now();
    /** @type {Intent["resolve"]} */
    const resolve = (state, me, moment) =>
      this._guarded(controls, key, presses, state, me, moment);
    return this.ask({ label: key ? keyWords(key) : "use", resolve, follows }, view);
  }

  /**
   * Handle a direction key, which counts as held until `release`.
   * @param {Controls} controls @param {Tile} direction @param {string} key @param {View} view
   */
  walk(controls, direction, key, view) {
    const intent = walkIntent(controls, [direction], keyWords(key));
    this._held = { key, since: this._game.now(), intent };
    return this.ask(intent, view);
  }

  /** Release the direction of a key, or any direction. @param {string | null} key */
  release(key = null) {
    if (key === null || key === this._held?.key) this._held = null;
  }

  /**
   * Do an action of the list of possible ones.
   * @param {Action} action @param {string} words @param {View} view
   */
  pick(action, words, view) {
    /** @type {Intent["resolve"]} */
    const resolve = (state, me) => {
      return { action, hint: words, valid: isValid(state, me, action), advice: false };
    };
    return this.ask({ label: words, resolve, action }, view);
  }

  // State of the queue

  /** Labels of the waiting actions, the next one first. */
  get labels() {
    const waiting = this._waiting.map(({ label }) => label);
    return this._retry ? [`${this._retry.label} (occupied)`, ...waiting] : waiting;
  }

  /** Station that the player walks to as soon as another player leaves it. */
  get awaited() {
    return this._retry?.action.destination ?? null;
  }

  /** The last action, until shortly after its result is known. */
  get sent() {
    const sent = this._sent;
    const shown = sent && (sent.fate === "asked" || this._game.now() - sent.time <= SHOWN_SECONDS);
    return shown ? sent : null;
  }

  /** Key of the action that takes a dish apart and was declined a moment ago. */
  get _confirmed() {
    const declined = this._apart;
    return declined && this._game.now() - declined.time < CONFIRM_SECONDS ? declined.key : "";
  }

  /** True shortly after the use key, when another press may be one too many. */
  get _repeatsUse() {
    return this._usedAt !== null && this._game.now() - this._usedAt < QUICK_SECONDS;
  }

  /**
   * Return the objects that the use key must leave, because it would undo the last action.
   * @param {boolean} repeats True shortly after another press. Only then, taking up what the player
   *   has worked on counts as one press too many: it is the natural next action.
   */
  _justUsed(repeats) {
    const sent = this._sent;
    if (sent?.fate !== "done" || sent.action.destination !== null) return new Set();
    if (this._game.now() - sent.time >= GUARD_SECONDS) return new Set();
    return sent.handled.size ? sent.handled : new Set(repeats ? sent.action.args : []);
  }

  /** True if no action is queued or awaits its result. */
  get idle() {
    return !this._retry && !this._waiting.length && this._sent?.fate !== "asked";
  }

  /** Drop the waiting actions and return whether there were any. */
  clear() {
    const had = this.labels.length > 0;
    this._forget();
    return had;
  }

  /**
   * Send an input's action now or queue it; return a notice for the player, or "".
   *
   * An input that follows a walk waits until the walk has succeeded. It does nothing if the walk
   * failed a moment ago. Any other input replaces a walk that is being retried.
   * @param {Intent} intent @param {View} view
   */
  ask(intent, view) {
    const { state, me, frozen } = view;
    if (frozen || !me || !state) return "";
    const asked = this._sent?.fate === "asked" ? this._sent : null;
    const walks = asked !== null && asked.action.destination !== null;
    const again = asked !== null && intent.action?.key === asked.action.key;
    // A second choice of the same action, while the first one is under way.
    if (again && unmet(state.changed(changes(state, asked.action)), asked.action).length) return "";
    if (intent.follows && (walks || this._retry)) return this._wait(intent);
    if (intent.follows && this._justFailed) return UNREACHED;
    this._failedAt = null;
    // The player has changed their mind about the occupied station.
    if (this._retry) this._forget();
    // A quick second press is meant for afterwards. A later one replaces the first action.
    const justSent = asked !== null && this._game.now() - asked.time < QUICK_SECONDS;
    if (state.busySteps(me) || justSent || this._waiting.length) return this._wait(intent);
    return this._do(intent, state, me, view);
  }

  /**
   * Record the result of the action that was sent.
   * @param {boolean} applied
   * @param {View} view
   */
  answered(applied, { state, me }) {
    const sent = this._sent;
    if (sent?.fate !== "asked") return;
    this._sent = { ...sent, time: this._game.now(), fate: applied ? "done" : "rejected" };
    this._retry = applied || !state || !me ? null : this._wanted(sent, state);
    if (!applied && !this._retry) this._fail(sent.action);
  }

  /**
   * Send what is due: the next queued action, or another walk in the held direction. Return a
   * notice for the player, or "".
   * @param {View} view
   */
  tick(view) {
    const now = this._game.now();
    // A pause does not use up the patience.
    if (view.frozen && this._retry) this._retry.until += now - this._tickedAt;
    this._tickedAt = now;
    const notice = this._next(view) || this._untold;
    this._untold = "";
    const held = this._held;
    // A held key never fills the queue, so the player stops where they let go.
    const free = view.state !== null && view.me !== null && !view.state.busySteps(view.me);
    if (held && this._game.now() - held.since >= REPEAT_SECONDS && free && this.idle) {
      this.ask(held.intent, view);
    }
    return notice;
  }

  /** @param {View} view */
  _next(view) {
    const { state, me } = view;
    if (view.over) this._forget();
    const waits = view.frozen || this._sent?.fate === "asked";
    if (waits || !me || !state || state.busySteps(me)) return "";
    const retry = this._retry;
    if (retry) {
      if (this._game.now() > retry.until) this._fail(retry.action, STILL_OCCUPIED);
      else if (isValid(state, me, retry.action)) this._send(retry.action, state);
      return "";
    }
    const intent = this._waiting.shift();
    return intent ? this._do(intent, state, me, view) : "";
  }

  /** @param {Intent} intent */
  _wait(intent) {
    // Directions that wait become one walk, which does not stop at the stations on the way.
    const last = this._waiting[this._waiting.length - 1];
    if (last?.directions && last.controls && intent.directions) {
      const directions = [...last.directions, ...intent.directions];
      if (directions.length <= MAX_DIRECTIONS) {
        const label = `${last.label} ${intent.label}`;
        this._waiting[this._waiting.length - 1] = walkIntent(last.controls, directions, label);
        return "";
      }
    }
    if (this._waiting.length >= MAX_QUEUED) return `${MAX_QUEUED} actions are queued already`;
    this._waiting.push(intent);
    return "";
  }

  _forget() {
    this._waiting = [];
    this._retry = null;
  }

  /** True for a moment after a walk has failed. */
  get _justFailed() {
    return this._failedAt !== null && this._game.now() - this._failedAt < GUARD_SECONDS;
  }

  /**
   * Drop what was meant to follow an action that was rejected for good.
   * @param {Action} action @param {string} notice Notice if nothing was meant to follow it.
   */
  _fail(action, notice = "") {
    if (action.destination !== null) {
      this._failedAt = this._game.now();
      const followed = this._waiting.some(({ follows }) => follows);
      // A later failure without words must not hide an earlier notice.
      this._untold = (followed ? UNREACHED : notice) || this._untold;
    }
    this._forget();
  }

  /** @param {Intent} intent @param {State} state @param {string} me @param {View} view */
  _do(intent, state, me, view) {
    const resolved = intent.resolve(state, me, view);
    if (!resolved.action) {
      // The waiting inputs were meant to follow this action.
      this._waiting = [];
      return capitalised(resolved.hint);
    }
    this._label = intent.label;
    this._send(resolved.action, state);
    return "";
  }

  /** @param {Action} action @param {State} state */
  _send(action, state) {
    const things = handled(state, action.player ?? "", action);
    this._sent = { action, time: this._game.now(), fate: "asked", state, handled: things };
    this._game.act(action);
  }

  /**
   * Return the retry of a rejected walk if only another player was in the way.
   * @param {Sent} sent @param {State} state
   */
  _wanted(sent, state) {
    const { action } = sent;
    if (action.destination === null) return null;
    const { occupancy } = preparationOf(state.task);
    const reasons = unmet(state, action);
    // The other player may have left since then. If nothing has changed, the reason is another.
    const gone = !reasons.length && state !== sent.state && !this._retry;
    // Other players move away after a while, but other conditions stay unmet.
    const taken = reasons.length > 0 && reasons.every((r) => occupancy.neededFree(r) !== null);
    if (!gone && !taken) return null;
    if (this._retry?.action.key === action.key) return this._retry;
    return { label: this._label, action, until: this._game.now() + PATIENCE_SECONDS };
  }

  /**
   * Resolve the use key, so that one press too many does not undo any work. In games that wait for
   * decisions, waiting is one of them.
   * @param {Controls} controls @param {string} key
   * @param {{repeats: boolean, confirmed: string}} presses The presses before this one.
   * @param {State} state @param {string} me @param {View} view @returns {Resolved}
   */
  _guarded(controls, key, { repeats, confirmed }, state, me, view) {
    let resolved = controls.use(state, me, key);
    if (resolved.hint === WAIT && (view.stepSeconds ?? null) === null) {
      const wait = controls.possible(state, me).find(isIdle) ?? null;
      resolved = { action: wait, hint: WAIT, valid: wait !== null, advice: false };
    }
    if (!resolved.action || !resolved.valid) return resolved;
    const used = this._justUsed(repeats);
    const again = [...handled(state, me, resolved.action)].some((name) => used.has(name));
    if (again) return { action: null, hint: GUARDED, valid: false, advice: false };
    const { key: declined } = resolved.action;
    if (declined === confirmed || !takesApart(state, resolved.action)) return resolved;
    this._apart = { key: declined, time: this._game.now() };
    return { action: null, hint: PART_OF_DISH, valid: false, advice: false };
  }
}

/**
 * Return a walk in some directions, to which the queue can add further ones.
 * @param {Controls} controls @param {Tile[]} directions @param {string} label @returns {Intent}
 */
function walkIntent(controls, directions, label) {
  const resolve = (/** @type {State} */ state, /** @type {string} */ me) =>
    controls.walk(state, me, directions);
  return { label, resolve, controls, directions };
}

/** @param {State} state @param {string} me @param {Action} action */
const isValid = (state, me, action) =>
  validActions(state, me).some(({ key }) => key === action.key);
