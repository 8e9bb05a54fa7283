// The state view, read as docs/protocol.md describes it: facts by name.

export class Facts {
  constructor(snapshot) {
    this.predicates = snapshot.predicates;
    this.objects = [];
    this.atoms = [];
    this.step = snapshot.step;
    this.extend(snapshot);
    this.facts = new Set(snapshot.facts);
  }

  extend({ objects = [], atoms = [] }) {
    this.objects.push(...objects.map((row) => row[0]));
    for (const [predicate, ...places] of atoms) {
      const names = places.map((place) => this.objects[place]);
      this.atoms.push(predicate < 0 ? null : `${this.predicates[predicate]}(${names.join(", ")})`);
    }
  }

  apply(delta) {
    if (delta.step !== this.step + 1) throw new Error(`step ${delta.step} after ${this.step}`);
    this.step = delta.step;
    this.extend(delta);
    for (const atom of delta.add ?? []) this.facts.add(atom);
    for (const atom of delta.remove ?? []) this.facts.delete(atom);
  }

  names() {
    return [...this.facts].map((place) => this.atoms[place]).filter(Boolean).sort();
  }
}
