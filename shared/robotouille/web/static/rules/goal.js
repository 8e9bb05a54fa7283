/**
 * The goal test: a backtracking search for objects that make goal predicates true.
 *
 * @typedef {import("./task.js").Task} Task
 * @typedef {import("./task.js").Term} Term
 * @typedef {import("./state.js").State} State
 * @typedef {string | number} Id Number or name of a variable; equal ids are the same object.
 * @typedef {Map<Id, string>} Binding
 * @typedef {Map<Id, Set<string>>} Domains
 * @typedef {{term: Term, choices: string[][]}[]} Rows Predicates, with the arguments for which
 *   each of them is true.
 * @typedef {[number, number[]][]} Order Numbers of the predicates in the order in which they are
 *   tried. Each has the numbers of predicates that must hold for it to count.
 * @typedef {{holding: boolean[], chosen: Binding}} Fit Predicates of a goal that hold at the same
 *   time, and the objects for which they hold.
 */
import { byNames } from "./state.js";

/** Rows at which a search looks before it gives up. */
const MAX_WORK = 180_000;

/** Goal of a task, or of a dish of a shift. */
export class Goal {
  /** @param {Task} task @param {Term[]} terms */
  constructor(task, terms = task.goal) {
    this.task = task;
    this.terms = terms;
    /** @type {Map<Id, string>} Kind or type of each variable. */
    this.kinds = new Map();
    for (const { ids, args } of terms) {
      ids.forEach((id, i) => this.kinds.has(id) || this.kinds.set(id, args[i]));
    }
    const labelled = [...task.things.values()].filter(({ label }) => typeof label === "string");
    this._labels = new Map(labelled.map(({ label, name }) => [/** @type {Id} */ (label), name]));
    this._work = 0;
  }

  /**
   * Return which predicates hold, and for which objects.
   *
   * A predicate holds if some choice of objects makes it true together with all earlier predicates
   * that hold. Predicates that cannot be decided in time count as not true.
   * @param {State} state
   * @param {Order} order By default the problem's order.
   * @returns {Fit}
   */
  fit(state, order = this.terms.map((_, number) => [number, []])) {
    /** @type {Rows} */
    let held = [];
    /** @type {Binding} */
    let chosen = new Map();
    const holding = this.terms.map(() => false);
    this._work = 0;
    for (const [number, needs] of order) {
      if (!needs.every((each) => holding[each])) continue;
      const term = this.terms[number];
      const rows = [...held, { term, choices: this._choices(term, state) }];
      // Usually the earlier choices can stay; otherwise all of them are reconsidered.
      const found = this._extended(chosen, rows[rows.length - 1]) ?? this._choice(rows, state);
      if (!found) continue;
      [held, chosen, holding[number]] = [rows, found, true];
    }
    return { holding, chosen };
  }

  /** Return the objects to which a variable can be bound. @param {Id} id @param {State} state */
  candidates(id, state) {
    const label = this._labels.get(id);
    if (label !== undefined) return [label];
    const kind = this.kinds.get(id) ?? "";
    const isType = this.task.types.includes(kind);
    const things = [...state.table.things.values()];
    return things.filter((each) => (isType ? each.type : each.kind) === kind).map((t) => t.name);
  }

  /**
   * Return the arguments for which a predicate is true. Equal ids get one object, and different
   * ids of a kind different objects.
   * @param {Term} term @param {State} state
   */
  _choices({ predicate, ids }, state) {
    const pools = ids.map((id) => new Set(this.candidates(id, state)));
    const atoms = [...state.truths(predicate)];
    if (this.task.isStatic(predicate)) atoms.sort(byNames);
    const choices = atoms.map(([, ...names]) => names);
    return choices.filter(
      (names) =>
        names.every((name, i) => pools[i].has(name)) &&
        ids.every((one, i) =>
          ids.every((other, j) => {
            if (one === other) return names[i] === names[j];
            return this.kinds.get(one) !== this.kinds.get(other) || names[i] !== names[j];
          }),
        ),
    );
  }

  /**
   * Extend a choice so that it makes one more predicate true; null if that is impossible.
   * @param {Binding} chosen @param {Rows[0]} row
   */
  _extended(chosen, { term, choices }) {
    for (const names of choices) {
      const both = new Map(chosen);
      const more = term.ids.filter((id) => !chosen.has(id));
      term.ids.forEach((id, i) => chosen.has(id) || both.set(id, names[i]));
      const fits = term.ids.every((id, i) => both.get(id) === names[i]);
      if (fits && more.every((id) => this._isFree(chosen, id, both.get(id)))) return both;
    }
    return null;
  }

  /**
   * Return whether no variable of the same kind is bound to an object.
   * @param {Binding} chosen @param {Id} id @param {string | undefined} name
   */
  _isFree(chosen, id, name) {
    const kind = this.kinds.get(id);
    return [...chosen].every(([other, taken]) => name !== taken || this.kinds.get(other) !== kind);
  }

  /**
   * Return a choice of objects that makes these predicates true, or null.
   * @param {Rows} rows @param {State} state
   */
  _choice(rows, state) {
    const ids = new Set(rows.flatMap(({ term }) => term.ids));
    const pools = new Map([...ids].map((id) => [id, this.candidates(id, state)]));
    const domains = new Map([...pools].map(([id, names]) => [id, new Set(names)]));
    return this._search(domains, rows, pools);
  }

  /**
   * Narrow the choices, then branch on the variable with the fewest choices left.
   * @param {Domains} domains @param {Rows} rows @param {Map<Id, string[]>} pools
   * @returns {Binding | null}
   */
  _search(domains, rows, pools) {
    const narrowed = this._narrow(domains, rows);
    if (!narrowed) return null;
    const undecided = [...narrowed.domains].filter(([, names]) => names.size > 1);
    if (!undecided.length) {
      return new Map([...narrowed.domains].map(([id, [name]]) => [id, name]));
    }
    const least = Math.min(...undecided.map(([, names]) => names.size));
    const [id, left] = undecided.find(([, names]) => names.size === least) ?? undecided[0];
    for (const name of pools.get(id) ?? []) {
      if (!left.has(name)) continue;
      const branch = new Map(narrowed.domains).set(id, new Set([name]));
      const found = this._search(branch, narrowed.rows, pools);
      if (found) return found;
    }
    return null;
  }

  /**
   * Remove choices that contradict another predicate; return null if none is left.
   *
   * Together with the test that there are enough objects of each kind, this keeps the search from
   * trying all permutations of interchangeable objects.
   * @param {Domains} given @param {Rows} givenRows
   */
  _narrow(given, givenRows) {
    const [domains, rows] = [new Map(given), [...givenRows]];
    const size = () => [...domains.values()].reduce((sum, names) => sum + names.size, 0);
    for (let before = -1; before !== size();) {
      before = size();
      for (const [position, { term, choices }] of rows.entries()) {
        this._work += choices.length;
        if (this._work > MAX_WORK) return null;
        const pools = term.ids.map((id) => domains.get(id));
        const kept = choices.filter((names) => names.every((name, i) => pools[i]?.has(name)));
        if (!kept.length) return null;
        rows[position] = { term, choices: kept };
        term.ids.forEach((id, i) => {
          const column = new Set(kept.map((names) => names[i]));
          domains.set(id, new Set([...(domains.get(id) ?? [])].filter((each) => column.has(each))));
        });
      }
      for (const kind of new Set(this.kinds.values())) {
        const group = [...domains.keys()].filter((id) => this.kinds.get(id) === kind);
        if (!makeDifferent(domains, group)) return null;
      }
    }
    return { domains, rows };
  }
}

/**
 * Remove decided objects from the other variables; return whether enough objects are left. The
 * test is a bipartite matching of variables and objects by augmenting paths.
 * @param {Domains} domains @param {Id[]} group
 */
function makeDifferent(domains, group) {
  const pool = (/** @type {Id} */ id) => domains.get(id) ?? new Set();
  for (const id of group) {
    if (pool(id).size !== 1) continue;
    const [decided] = pool(id);
    for (const other of group) {
      if (other === id) continue;
      domains.set(other, new Set([...pool(other)].filter((name) => name !== decided)));
    }
  }
  /** @type {Map<string, Id>} */
  const owners = new Map();
  /** @type {(id: Id, tried: Set<string>) => boolean} */
  const find = (id, tried) => {
    for (const name of pool(id)) {
      if (tried.has(name)) continue;
      tried.add(name);
      const owner = owners.get(name);
      if (owner === undefined || find(owner, tried)) {
        owners.set(name, id);
        return true;
      }
    }
    return false;
  };
  return group.every((id) => find(id, new Set()));
}
