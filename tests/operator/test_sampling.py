"""What a server may run out of is looked at rarely, and cheaply."""

from __future__ import annotations

import asyncio
import errno
import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille_server.health import SAMPLE_SECONDS, Disk, Health, System
from robotouille_server.runtime import descriptors
from robotouille_server.runtime.metrics import Metrics
from tests.support.machines import Machine
from tests.support.servers import serving
from tests.support.virtual_time import run


def test_looking_is_rare_however_often_somebody_asks(tmp_path: Path) -> None:
    machine = Machine()
    resources = Health(Metrics(), tmp_path, machine)
    for tick in range(101):
        resources.sample(tick / 10, [])
    assert machine.looks == 1 + 10 / SAMPLE_SECONDS


def test_metrics_have_the_same_figures(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            machine = server.health.system = Machine()
            machine.free, machine.open, machine.most = Disk(123, 456), 77, 99
            server.metrics.log_suppressed = 3
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            page = (await reader.read()).decode()
            writer.close()
        for line in (
            "robotouille_disk_free_bytes 123.0",
            "robotouille_open_descriptors 77.0",
            "robotouille_max_descriptors 99.0",
            "robotouille_suppressed_log_lines_total 3.0",
            "robotouille_busiest_participant_bytes_per_second 0.0",
        ):
            assert f"\n{line}\n" in page

    run(main())


def test_the_real_machine_has_a_disk_and_descriptors(tmp_path: Path) -> None:
    system = System()
    disk, used, most = system.disk(tmp_path), system.descriptors(), system.max_descriptors()
    assert disk is None or 0 < disk.free <= disk.size
    assert used is None or most is None or 3 <= used <= most
    with tmp_path.joinpath("x").open("w"):
        assert used is None or system.descriptors() == used + 1


@pytest.mark.skipif(sys.platform == "win32", reason="nobody says it there")
def test_descriptors_are_counted_without_listing_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 20,000 a list takes 50 ms, for which all games would wait."""

    def listed(*_: Any) -> None:
        raise AssertionError("listed")

    for module, name in ((os, "listdir"), (os, "scandir"), (Path, "iterdir")):
        monkeypatch.setattr(module, name, listed)
    used = System().descriptors()
    monkeypatch.setattr(descriptors, "OPEN", str(tmp_path / "nothing says it"))
    at_least = System().descriptors()
    assert used is not None
    assert at_least is not None
    assert 3 <= at_least <= used + 1
    with ExitStack() as stack:
        for _ in range(used + 1):
            stack.enter_context(open(os.devnull))  # noqa: PTH123
        assert (System().descriptors() or 0) > used


@pytest.mark.skipif(sys.platform == "win32", reason="nobody says it there")
def test_a_process_without_any_descriptor_left_says_that_all_are_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> int:
        raise OSError(errno.EMFILE, "too many open files")

    monkeypatch.setattr(descriptors, "OPEN", str(tmp_path / "nothing says it"))
    monkeypatch.setattr(os, "open", refused)
    assert System().descriptors() == descriptors.limit()
