"""How old deltas are when they are sent: the time that writing took is part of it."""

from __future__ import annotations

import asyncio
from pathlib import Path

from prometheus_client.parser import text_string_to_metric_families

from robotouille_client import connect
from robotouille_server import Server
from tests.support.disks import TroubledFolder
from tests.support.servers import serving
from tests.support.virtual_time import VirtualTimeLoop, run

WRITING = 0.3


class SlowDisk(TroubledFolder):
    """A folder in which each append takes its time, once it is slow."""

    slow = False

    def before_append(self, name: str) -> None:
        if self.slow:
            pass_time(WRITING)


def pass_time(seconds: float) -> None:
    """Nothing else happens meanwhile: the process waits for its disk."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._jumping.now += seconds


def ages(server: Server) -> tuple[float, float]:
    """How many deltas were sent, and their ages in seconds together."""
    for family in text_string_to_metric_families(server.metrics.page().decode()):
        if family.name == "robotouille_delta_age_seconds":
            values = {sample.name: sample.value for sample in family.samples}
            return values[f"{family.name}_count"], values[f"{family.name}_sum"]
    raise AssertionError("there is no such metric")


def test_a_delta_is_as_old_as_its_step_when_it_is_sent(tmp_path: Path) -> None:
    async def main() -> None:
        disk = SlowDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as server,
            connect(server.url, name="ada") as ada,
        ):
            game = await ada.join((await ada.create("synchronous/01")).code)
            for _ in range(3):
                await game.act(game.actions[0])
            count, total = ages(server)
            assert count == 3
            assert total < WRITING, "nothing has taken any time yet"
            disk.slow = True
            for _ in range(3):
                await game.act(game.actions[0])
            later_count, later_total = ages(server)
            assert later_count == 6
            assert 3 * WRITING <= later_total - total + 1e-6 < 3 * WRITING + 0.1
            disk.slow = False

    run(main())
