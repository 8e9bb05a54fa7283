"""What connections share: so much of each turn of the event loop, and so many of them."""

from __future__ import annotations

import asyncio

from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import Admission, LoopBudget
from robotouille_server.transport.admission import LOOP_BUDGET


def test_a_turn_has_a_budget_and_the_next_one_has_another() -> None:
    async def main() -> None:
        budget = LoopBudget(asyncio.get_running_loop())
        assert budget.free
        budget.spend(LOOP_BUDGET - 1)
        assert not budget.over
        budget.spend(1)
        assert budget.over
        assert not budget.free
        await asyncio.sleep(0)
        assert budget.free

    asyncio.run(main())


def test_those_who_wait_have_their_turns_in_order_and_as_far_as_the_budget_goes() -> None:
    async def main() -> None:
        budget, served = LoopBudget(asyncio.get_running_loop()), []

        def serve(name: str) -> None:
            served.append(name)
            budget.spend(LOOP_BUDGET / 2)

        for name in ("ada", "bob", "cy"):
            budget.wait(lambda name=name: serve(name))  # type: ignore[misc]
        assert not budget.free, "newcomers wait behind them"
        await asyncio.sleep(0)
        assert served == ["ada", "bob"]
        await asyncio.sleep(0)
        assert served == ["ada", "bob", "cy"]

    asyncio.run(main())


def test_so_many_may_be_connected() -> None:
    async def main() -> None:
        admission = Admission(Metrics(), 2, opening_seconds=1.0)
        assert [admission.admit() for _ in range(3)] == [True, True, False]
        admission.release()
        assert admission.admit()

    asyncio.run(main())
