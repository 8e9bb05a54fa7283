"""Distributions of durations with one per cent of error that can be added.

The buckets are sparse, unlike those of HdrHistogram: the report keeps one distribution for each
measurement and second, and most of them have few different durations. An hour would take about
900 MB with 26 KiB for each.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, log

SMALLEST = 1e-6
"""Shortest duration in seconds. Shorter ones count as this long."""
GROWTH = 0.01
"""Relative width of a bucket."""
BUCKETS_PER_E = 1 / GROWTH
MAX_COUNTERS = 200
"""Names of counts. The counts of further names are added up."""
MAX_COUNTER_NAME = 100
"""Characters of such a name. Some names contain what the server sends."""


class Histogram:
    """Durations in seconds, in buckets that grow by one per cent.

    `largest` is exact. Percentiles are exact to within a bucket.
    """

    __slots__ = ("_counts", "count", "largest", "total")

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self.count = 0
        self.total = 0.0
        self.largest = 0.0

    def add(self, seconds: float) -> None:
        bucket = int(log(seconds / SMALLEST) * BUCKETS_PER_E) if seconds > SMALLEST else 0
        counts = self._counts
        counts[bucket] = counts.get(bucket, 0) + 1
        self.count += 1
        self.total += seconds
        self.largest = max(self.largest, seconds)

    def merge(self, other: Histogram) -> None:
        for bucket, times in other._counts.items():
            self._counts[bucket] = self._counts.get(bucket, 0) + times
        self.count += other.count
        self.total += other.total
        self.largest = max(self.largest, other.largest)

    @property
    def mean(self) -> float:
        return self.total / self.count if self.count else 0.0

    def percentile(self, percent: float) -> float:
        """Return the duration that `percent` of all do not exceed; 0.0 without durations."""
        wanted = self.count * percent / 100
        for bucket, passed in self._passed():
            if passed >= wanted:
                return min(_middle(bucket), self.largest)
        return self.largest

    def share_within(self, seconds: float) -> float:
        """Return the share of durations up to a limit; 1.0 without durations."""
        if not self.count:
            return 1.0
        within = sum(n for bucket, n in self._counts.items() if _middle(bucket) <= seconds)
        return within / self.count

    def spectrum(self) -> list[tuple[float, float]]:
        """Return rising pairs of a share and the duration that this share does not exceed."""
        return [
            (passed / self.count, min(_middle(bucket), self.largest))
            for bucket, passed in self._passed()
        ]

    def _passed(self) -> Iterator[tuple[int, int]]:
        passed = 0
        for bucket in sorted(self._counts):
            passed += self._counts[bucket]
            yield bucket, passed

    def to_json(self) -> list[object]:
        """Return the total, the largest duration, and then each bucket and its count."""
        pairs: list[object] = [self.total, self.largest]
        for item in sorted(self._counts.items()):
            pairs += item
        return pairs

    @classmethod
    def from_json(cls, plain: list[float]) -> Histogram:
        histogram = cls()
        histogram.total, histogram.largest = plain[0], plain[1]
        buckets, counts = plain[2::2], plain[3::2]
        for bucket, times in zip(buckets, counts, strict=True):
            histogram._counts[int(bucket)] = int(times)
            histogram.count += int(times)
        return histogram


def _middle(bucket: int) -> float:
    return SMALLEST * exp((bucket + 0.5) / BUCKETS_PER_E)


class Measurements:
    """Named distributions and counts of a period of time."""

    def __init__(self) -> None:
        self.durations: dict[str, Histogram] = {}
        self.counts: dict[str, float] = {}

    def took(self, name: str, seconds: float) -> None:
        histogram = self.durations.get(name)
        if histogram is None:
            histogram = self.durations[name] = Histogram()
        histogram.add(seconds)

    def count(self, name: str, amount: float = 1) -> None:
        name = name[:MAX_COUNTER_NAME]
        if name not in self.counts and len(self.counts) >= MAX_COUNTERS:
            name = "others"
        self.counts[name] = self.counts.get(name, 0) + amount

    def merge(self, other: Measurements) -> None:
        for name, histogram in other.durations.items():
            self.durations.setdefault(name, Histogram()).merge(histogram)
        for name, amount in other.counts.items():
            self.count(name, amount)

    def duration(self, name: str) -> Histogram:
        """Return the distribution of that name, which is empty if nothing was measured."""
        return self.durations.get(name) or Histogram()

    def to_json(self) -> dict[str, object]:
        durations = {name: histogram.to_json() for name, histogram in self.durations.items()}
        return {"durations": durations, "counts": self.counts}

    @classmethod
    def from_json(cls, plain: dict[str, dict[str, list[float]]]) -> Measurements:
        measurements = cls()
        for name, histogram in plain["durations"].items():
            measurements.durations[name] = Histogram.from_json(histogram)
        measurements.counts = {**plain["counts"]}  # type: ignore[dict-item]
        return measurements
