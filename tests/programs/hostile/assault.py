"""One process of the hostile run, with its share of all messages and files."""

from __future__ import annotations

import asyncio
import faulthandler
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from tests.programs.hostile.siege import Siege
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.hostile_inputs import HOSTILE_INPUTS
from tests.support.fuzzing.specimens import FILE_KINDS, MESSAGE_KINDS
from tests.support.fuzzing.targets import Target, file_targets, message_targets

__all__ = ["HANG", "MIX", "Report", "Share", "assault"]

MIX = {"socket": 70, "decoder": 20, "recording": 5, "file": 5}
"""Percentage of hostile inputs for each destination."""
CHUNK = 1000
"""Inputs between two reports."""
LANES = 4
"""Simultaneous connections per process."""
HANG = 120.0
"""Seconds without progress after which a process gives up and reports its position."""


class Reports(Protocol):
    def put(self, report: Report) -> None: ...


@dataclass(slots=True)
class Report:
    """A process's results since its last report; `kept` contains inputs that caused faults."""

    worker: int
    done: int
    outcomes: Counter[str]
    faults: list[str]
    kept: list[bytes] = field(default_factory=list)
    last: bool = False


@dataclass(frozen=True, slots=True)
class Share:
    """The share of one process."""

    worker: int
    count: int
    seed: int
    port: int


def assault(share: Share, reports: Reports) -> None:
    """Process a share and report progress."""
    asyncio.run(_assault(share, reports))


async def _assault(share: Share, reports: Reports) -> None:
    seed = share.seed * 1000 + share.worker
    sieges = [Siege(share.port, Adversary(seed + lane * 100)) for lane in range(LANES)]
    adversary = Adversary(seed)
    with tempfile.TemporaryDirectory(prefix="robotouille-hostile-") as folder:
        readers = message_targets() | file_targets(Path(folder))
        left = share.count
        while left > 0:
            faulthandler.dump_traceback_later(HANG, exit=True)
            report = Report(share.worker, min(CHUNK, left), Counter(), [])
            left -= report.done
            await _chunk(report, sieges, adversary, readers)
            report.last = left == 0 or len(report.faults) > 100
            reports.put(report)
            if report.last:
                break
    for siege in sieges:
        siege.withdraw()
    faulthandler.cancel_dump_traceback_later()


async def _chunk(
    report: Report, sieges: list[Siege], adversary: Adversary, readers: dict[str, Target]
) -> None:
    parts = {name: report.done * percent // 100 for name, percent in MIX.items()}
    parts["socket"] += report.done - sum(parts.values())
    lanes = [parts["socket"] // LANES + (i < parts["socket"] % LANES) for i in range(LANES)]
    await asyncio.gather(*(s.attack(n) for s, n in zip(sieges, lanes, strict=True)))
    for siege in sieges:
        report.outcomes.update({f"socket: {word}": n for word, n in siege.outcomes.items()})
        report.faults += siege.faults
        siege.outcomes.clear()
        siege.faults.clear()
    kinds: dict[str, tuple[str, ...]] = {
        "decoder": MESSAGE_KINDS,
        "recording": ("recording",),
        "file": FILE_KINDS,
    }
    for name, of_kind in kinds.items():
        for _ in range(parts[name]):
            kind = adversary.random.choice(of_kind)
            _read(report, kind, readers[kind], HOSTILE_INPUTS[kind], adversary)


def _read(
    report: Report,
    kind: str,
    reader: Target,
    offer: Callable[[Adversary], bytes],
    adversary: Adversary,
) -> None:
    data = offer(adversary)
    try:
        report.outcomes[f"{kind}: {reader(data)}"] += 1
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        report.faults.append(f"{kind}: {type(error).__name__} at {where}: {str(error)[:200]}")
        report.kept.append(data)
