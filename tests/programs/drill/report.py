"""The result of a drill as a table and as JSON."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from tests.programs.drill.drill import Result
from tests.programs.drill.verdict import Verdict

__all__ = ["aligned", "counts", "spread", "table", "verdict_rows", "write_json"]

MAX_SHOWN = 40


def table(result: Result) -> str:
    """Return the figures, and the evidence of faults."""
    verdict = result.verdict
    kills = ", ".join(f"{count} {kind}" for kind, count in sorted(result.kills.items()))
    rows = [
        ("kills", f"{result.signals['SIGKILL']} SIGKILL ({result.plan.kills} requested) and"
                  f" {result.signals['SIGTERM']} additional SIGTERM"),
        ("when", kills or "none"),
        ("lives of the server", f"{result.lives}"),
        ("time", f"{result.seconds:.0f} s"),
        ("episodes restored", f"{sum(result.restored)}, at most {max(result.restored, default=0)}"),
        ("start → listening", spread(result.start_seconds)),
        ("SIGTERM → ended", spread(result.stop_seconds)),
        ("kill → all clients back", spread(result.back_seconds)),
        ("one client's absence", spread(result.absence_seconds)),
        ("seats that received the outcome", counts(result.told)),
        ("windows", f"{result.pictures} checks that found the episode, at the start and after"
                    f" outages; {result.clicks} clicks and keys"),
        ("accidents of pages", counts(result.accidents)),
        *verdict_rows(verdict),
    ]  # fmt: skip
    return aligned(rows, result.faults)


def verdict_rows(verdict: Verdict) -> list[tuple[str, str]]:
    """Return the figures of a comparison."""
    return [
        ("games", f"{verdict.games} ({counts(verdict.outcomes)})"),
        ("restarts in a game", f"at most {max(verdict.restarts, default=0)}"),
        ("games when restarted", counts(verdict.restarted)),
        ("other recordings", f"{verdict.others}"),
        ("recordings verified", f"{verdict.verified}"),
        ("steps recorded", f"{verdict.steps}"),
        ("controllers", counts(verdict.controllers)),
        ("compared", f"{verdict.states} states, {verdict.deltas} deltas, {verdict.actions} replies"
                     f" to actions, {verdict.chat} received chat messages"),
        ("players who lost their seat", f"{len(verdict.lost)}"),
        ("chat that was not received", f"{verdict.unheard}"),
        ("spectators that missed the end", f"{verdict.unaware}"),
    ]  # fmt: skip


def aligned(rows: list[tuple[str, str]], faults: list[str]) -> str:
    """Return figures as a table, followed by the evidence of faults."""
    rows = [*rows, ("violations", f"{len(faults)}")]
    width = max(len(name) for name, _ in rows)
    lines = [f"{name:{width}}  {value}" for name, value in rows]
    lines += [f"  ! {fault}" for fault in faults[:MAX_SHOWN]]
    if len(faults) > MAX_SHOWN:
        lines.append(f"  … and {len(faults) - MAX_SHOWN} more")
    return "\n".join(lines)


def counts(numbers: dict[str, int]) -> str:
    """Format numbers with their names."""
    return ", ".join(f"{count} {name}" for name, count in sorted(numbers.items())) or "none"


def spread(seconds: list[float]) -> str:
    """Format the median, the 90th and 99th percentile, and the maximum."""
    if not seconds:
        return "none"
    ordered = sorted(seconds)
    at = [ordered[min(len(ordered) - 1, int(len(ordered) * part))] for part in (0.5, 0.9, 0.99)]
    half, most, nearly, longest = *at, ordered[-1]
    return (
        f"p50 {half:.2f} s, p90 {most:.2f} s, p99 {nearly:.2f} s, max {longest:.2f} s"
        f" ({len(ordered)} times)"
    )


def write_json(result: Result, path: Path) -> None:
    """Write all figures and faults as JSON."""
    path.write_text(json.dumps(_plain(result), indent=1) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
