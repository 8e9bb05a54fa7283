"""Going round all of some things again and again."""

from __future__ import annotations

import asyncio

from robotouille_server.runtime.rounds import Rounds
from tests.support.virtual_time import run

SECONDS = 10.0


class Seen:
    """Counts how often it was looked at, and whether in a turn of the event loop of its own."""

    turn = 0

    def __init__(self, *, busy: bool) -> None:
        self._busy = busy
        self.turns: list[int] = []

    def look(self) -> bool:
        self.turns.append(Seen.turn)
        return self._busy


async def count_turns() -> None:
    while True:
        Seen.turn += 1
        await asyncio.sleep(0)


def test_all_are_looked_at_in_each_round_until_it_is_stopped() -> None:
    async def main() -> None:
        live = [Seen(busy=True) for _ in range(3)]
        rounds = Rounds(set(live), SECONDS, Seen.look)
        rounds.begin()
        rounds.begin()
        await asyncio.sleep(SECONDS * 2.5)
        rounds.stop()
        assert [len(one.turns) for one in live] == [2, 2, 2]
        await asyncio.sleep(SECONDS * 2)
        assert [len(one.turns) for one in live] == [2, 2, 2]

    run(main())


def test_who_had_something_to_do_has_a_turn_of_its_own() -> None:
    async def main() -> list[set[int]]:
        found = []
        for busy in (True, False):
            live = {Seen(busy=busy) for _ in range(3)}
            rounds = Rounds(live, 0.0, Seen.look)
            counting = asyncio.create_task(count_turns())
            rounds.begin()
            while not all(one.turns for one in live):
                await asyncio.sleep(0)
            rounds.stop()
            counting.cancel()
            found.append({one.turns[0] for one in live})
        return found

    apart, together = run(main())
    assert len(apart) == 3
    assert len(together) == 1


def test_what_has_gone_since_the_round_began_is_not_looked_at() -> None:
    async def main() -> None:
        live: set[Seen] = set()
        first = Seen(busy=True)

        def look(one: Seen) -> bool:
            live.difference_update(set(live) - {one})
            return one.look()

        live.update({first, Seen(busy=True), Seen(busy=True)})
        everyone = set(live)
        rounds = Rounds(live, SECONDS, look)
        rounds.begin()
        await asyncio.sleep(SECONDS * 1.5)
        assert sum(len(one.turns) for one in everyone) == 1
        rounds.stop()

    run(main())


def test_rounds_end_when_nothing_is_left_and_may_begin_again() -> None:
    async def main() -> None:
        one = Seen(busy=False)
        live = {one}
        rounds = Rounds(live, SECONDS, Seen.look)
        rounds.begin()
        await asyncio.sleep(SECONDS * 1.5)
        live.clear()
        await asyncio.sleep(SECONDS * 3)
        live.add(one)
        rounds.begin()
        await asyncio.sleep(SECONDS * 1.5)
        assert len(one.turns) == 2
        rounds.stop()

    run(main())
