"""Play a task with one player by Monte Carlo tree search.

python examples/search/mcts.py [TASK]

The world is deterministic and has no opponents, so the value of a state is the best result found
below it, not the mean. Only the order in which new states are tried is random.
"""

from __future__ import annotations

import math
import random
import sys

from robotouille import GroundAction, State, World


class Mcts:
    def __init__(self, player: str, seed: int = 0) -> None:
        self.player, self.random = player, random.Random(seed)
        self.visits: dict[State, int] = {}
        self.value: dict[State, float] = {}

    def act(self, state: State, simulations: int = 200) -> GroundAction:
        for _ in range(simulations):
            self.simulate(state)
        after = self.successors(state)
        return max(after, key=lambda action: self.value.get(after[action], 0.0))

    def simulate(self, state: State, depth: int = 30) -> None:
        path = [state]
        while path[-1] in self.visits and not path[-1].goal_reached and len(path) < depth:
            new = [s for s in self.successors(path[-1]).values() if s not in path]
            if not new:
                break
            tries = self.visits[path[-1]]
            path.append(max(new, key=lambda after: self.promise(after, tries)))
        worth = self.worth(path[-1])
        for seen in reversed(path):
            self.visits[seen] = self.visits.get(seen, 0) + 1
            self.value[seen] = worth = max(worth, self.value.get(seen, 0.0))
            worth *= 0.98

    def promise(self, state: State, tries: int) -> float:
        if state not in self.visits:
            return 10 + self.random.random()
        return self.value[state] + 0.2 * math.sqrt(math.log(tries) / self.visits[state])

    def worth(self, state: State) -> float:
        terms = state.world.goal_terms(state)
        return 1.0 if state.goal_reached else 0.8 * sum(holds for _, holds in terms) / len(terms)

    def successors(self, state: State) -> dict[GroundAction, State]:
        return {a: state.world.successor(state, a) for a in state.actions(self.player)}


if __name__ == "__main__":
    state = World(sys.argv[1] if len(sys.argv) > 1 else "synchronous/01").initial
    search = Mcts(state.world.players[0])
    for _ in range(100):
        if state.goal_reached:
            break
        action = search.act(state)
        print(action.sentence)
        state = state.world.successor(state, action)
