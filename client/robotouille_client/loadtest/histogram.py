"""Distributions of durations: constant memory, about one per cent of error, made to be added."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, log

__all__ = ["Histogram", "Measurements"]

SMALLEST = 1e-6
"""Seconds; whatever is shorter counts as this long."""
GROWTH = 0.01
"""Each bucket ends this fraction above the one before, give or take."""
PER_DECADE = 1 / GROWTH


class Histogram:
    """Durations in seconds, in buckets that grow by one per cent.

    The largest is kept exactly; a percentile is right to within a bucket.
    """

    __slots__ = ("_counts", "count", "largest", "total")

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self.count = 0
        self.total = 0.0
        self.largest = 0.0

    def add(self, seconds: float, times: int = 1) -> None:
        bucket = int(log(seconds / SMALLEST) * PER_DECADE) if seconds > SMALLEST else 0
        counts = self._counts
        counts[bucket] = counts.get(bucket, 0) + times
        self.count += times
        self.total += seconds * times
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
        """The duration that `percent` of all do not exceed; 0.0 where there are none."""
        wanted = self.count * percent / 100
        for bucket, passed in self._passed():
            if passed >= wanted:
                return min(_middle(bucket), self.largest)
        return self.largest

    def share_within(self, seconds: float) -> float:
        """The share of durations that are at most so long; 1.0 where there are none."""
        if not self.count:
            return 1.0
        within = sum(n for bucket, n in self._counts.items() if _middle(bucket) <= seconds)
        return within / self.count

    def spectrum(self) -> list[tuple[float, float]]:
        """Rising pairs of a share (of 1) and the duration that this share does not exceed."""
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
        """Plain values that `from_json` reads: total, largest, buckets and counts by turns."""
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
    return SMALLEST * exp((bucket + 0.5) / PER_DECADE)


class Measurements:
    """Named distributions and counts of some stretch of time."""

    def __init__(self) -> None:
        self.durations: dict[str, Histogram] = {}
        self.counts: dict[str, float] = {}

    def took(self, name: str, seconds: float) -> None:
        histogram = self.durations.get(name)
        if histogram is None:
            histogram = self.durations[name] = Histogram()
        histogram.add(seconds)

    def count(self, name: str, amount: float = 1) -> None:
        self.counts[name] = self.counts.get(name, 0) + amount

    def merge(self, other: Measurements) -> None:
        for name, histogram in other.durations.items():
            self.durations.setdefault(name, Histogram()).merge(histogram)
        for name, amount in other.counts.items():
            self.count(name, amount)

    def duration(self, name: str) -> Histogram:
        """The distribution of that name, empty where nothing was measured."""
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
