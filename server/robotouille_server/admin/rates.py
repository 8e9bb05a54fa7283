"""Rates and percentiles from counters that only grow."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from prometheus_client import Counter, Gauge

from robotouille_server.admin.models import Lateness
from robotouille_server.runtime.metrics import BUCKETS, Metrics

__all__ = ["History", "RateOf", "by_label", "gauge"]

KEPT_SECONDS = 60
SMOOTHED_SECONDS = 5
FORGOTTEN_AFTER = 30.0


@dataclass(frozen=True, slots=True)
class RateSample:
    """The counters at one moment; `late` are steps by how late they were, bucket by bucket."""

    at: float
    steps: float
    sent_bytes: float
    received: float
    late: tuple[int, ...]


class History:
    """The counters of the last minute, one sample a second."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._samples: deque[RateSample] = deque(maxlen=KEPT_SECONDS + 1)

    def sample(self, now: float) -> None:
        """To be called about once a second."""
        metrics = self._metrics
        late = tuple(metrics.lateness.counts)
        self._samples.append(
            RateSample(now, metrics.steps, metrics.sent_bytes, metrics.received, late)
        )

    def rate(self, of: Callable[[RateSample], float]) -> float:
        """A counter's growth a second over the last few seconds."""
        recent = list(self._samples)[-SMOOTHED_SECONDS - 1 :]
        return round(_growth(recent[0], recent[-1], of), 1) if len(recent) > 1 else 0.0

    def seconds(self, of: Callable[[RateSample], float]) -> list[float]:
        """A counter's growth in each of the last seconds, oldest first."""
        return [round(_growth(a, b, of), 1) for a, b in pairwise(self._samples)]

    def lateness(self) -> Lateness:
        """Of the steps of the last minute."""
        if len(self._samples) < 2:
            return Lateness(steps=0, p50=None, p99=None, p999=None)
        first, last = self._samples[0].late, self._samples[-1].late
        counts = [after - before for before, after in zip(first, last, strict=True)]
        return Lateness(
            steps=sum(counts),
            p50=_bound(counts, 0.5),
            p99=_bound(counts, 0.99),
            p999=_bound(counts, 0.999),
        )


def _bound(counts: list[int], share: float) -> float | None:
    """Milliseconds that at most `1 - share` of the steps exceed; None beyond the last bucket."""
    total, seen = sum(counts), 0
    for bound, count in zip(BUCKETS, counts, strict=False):
        seen += count
        if total and seen >= share * total:
            return bound * 1000
    return None


class RateOf:
    """Growth a second of counters that are asked for by name; None at first."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[float, float, float | None]] = {}

    def __call__(self, name: str, count: float, now: float) -> float | None:
        """The rate of `name`, whose counter is at `count`; measured over a second or more."""
        at, before, rate = self._seen.get(name, (now, count, None))
        if now - at >= 1.0:
            rate = round(max(0.0, count - before) / (now - at), 1)
            at, before = now, count
        self._seen[name] = at, before, rate
        return rate

    def forget(self, now: float) -> None:
        """Drop what nobody has asked for lately."""
        self._seen = {
            name: seen for name, seen in self._seen.items() if now - seen[0] < FORGOTTEN_AFTER
        }


def by_label(counter: Counter) -> dict[str, int]:
    """A counter's values by its only label, the largest first."""
    found = {
        next(iter(sample.labels.values())): int(sample.value)
        for family in counter.collect()
        for sample in family.samples
        if sample.name.endswith("_total")
    }
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def gauge(value: Gauge) -> int:
    """What a gauge stands at."""
    return int(next(sample.value for family in value.collect() for sample in family.samples))


def _growth(first: RateSample, last: RateSample, of: Callable[[RateSample], float]) -> float:
    return (of(last) - of(first)) / max(last.at - first.at, 1e-9)
