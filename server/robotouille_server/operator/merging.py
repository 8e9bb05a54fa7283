"""One overview from those of all nodes of a cluster."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from operator import attrgetter

from robotouille_server.operator.models import (
    EpisodeCounts,
    EpisodeRow,
    Lateness,
    NodeOverview,
    NodeRow,
    Overview,
    Totals,
)

PHASES = ("paused", "running", "waiting", "ended")
"""Phases in the order of the overview: those that need the operator come first."""


def rank(phase: str, problem: str) -> int:
    """Return the rank of an episode in the overview: problems first, ended episodes last."""
    return PHASES.index(phase) + (0 if problem else len(PHASES))


def parts_of_page(ranks: Sequence[Sequence[int]], offset: int, limit: int) -> list[tuple[int, int]]:
    """Return which part of each node's list is on a page of the whole list.

    The whole list contains all nodes' episodes of one rank before those of the next. So what a node
    has on one page is contiguous in its own list.

    Args:
        ranks: The number of episodes of each rank, of each node.
        offset: The number of rows before the page.
        limit: The number of rows of the page.

    Returns:
        The first row and the number of rows, for each node.
    """
    starts, counts, passed = [0] * len(ranks), [0] * len(ranks), 0
    for of_rank in zip(*ranks, strict=True):
        for node, count in enumerate(of_rank):
            before = min(count, max(0, offset - passed))
            starts[node] += before
            on_page = max(0, min(passed + count, offset + limit) - max(passed, offset))
            counts[node] += on_page
            passed += count
    return list(zip(starts, counts, strict=True))


def on_node(overview: NodeOverview, node: str, limit: int) -> NodeOverview:
    """Return another node's part of an overview with its address, and at most `limit` rows."""
    named = {"node": node}
    # A newer version may have other phases.
    known = [row for row in overview.episodes[:limit] if row.phase in PHASES]
    return overview.model_copy(
        update={
            "alerts": [alert.model_copy(update=named) for alert in overview.alerts],
            "faults": [fault.model_copy(update=named) for fault in overview.faults],
            "episodes": [row.model_copy(update=named) for row in known],
        }
    )


def merged(
    own: NodeOverview,
    others: Sequence[NodeOverview],
    rows: Iterable[EpisodeRow],
    nodes: list[NodeRow],
) -> Overview:
    """Return the overview of a cluster.

    Args:
        own: The overview of the node that was asked.
        others: The overviews of the nodes that have answered.
        rows: The episodes to show, those of one node after those of another.
        nodes: The nodes.
    """
    all_of = [own, *others]
    # An episode that is being handed over may be on two nodes for a moment.
    shown = {row.episode: row for row in rows}
    alerts = [alert for each in all_of for alert in each.alerts]
    return Overview(
        server=own.server,
        totals=_added([each.totals for each in all_of]),
        alerts=sorted(alerts, key=lambda alert: alert.severity != "critical"),
        faults=[fault for each in all_of for fault in each.faults],
        found=sum(each.found for each in all_of),
        episodes=sorted(shown.values(), key=lambda row: rank(row.phase, row.problem)),
        nodes=nodes,
    )


def _added(totals: Sequence[Totals]) -> Totals:
    counts = [one.episodes for one in totals]
    return Totals(
        connections=sum(one.connections for one in totals),
        episodes=EpisodeCounts(**{name: sum(map(attrgetter(name), counts)) for name in PHASES}),
        steps_per_second=_sum(one.steps_per_second for one in totals),
        sent_bytes_per_second=_sum(one.sent_bytes_per_second for one in totals),
        received_per_second=_sum(one.received_per_second for one in totals),
        lateness=_slowest([one.lateness for one in totals]),
        history={
            name: _added_histories([one.history.get(name, []) for one in totals])
            for name in totals[0].history
        },
        errors=_added_counts(one.errors for one in totals),
        dropped=_added_counts(one.dropped for one in totals),
    )


def _sum(values: Iterable[float]) -> float:
    return round(sum(values), 1)


def _added_histories(histories: Iterable[list[float]]) -> list[float]:
    """Add histories that all end now."""
    newest_first = zip_longest(*(reversed(history) for history in histories), fillvalue=0.0)
    return [_sum(values) for values in newest_first][::-1]


def _added_counts(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    added: Counter[str] = Counter()
    for one in counts:
        added.update(one)
    return dict(added.most_common())


def _slowest(nodes: Sequence[Lateness]) -> Lateness:
    """Return the largest bounds. Null with steps means that a bound exceeds the last bucket."""
    busy = [one for one in nodes if one.steps]

    def largest(name: str) -> float | None:
        bounds = [getattr(one, name) for one in busy]
        return None if None in bounds else max(bounds, default=None)

    return Lateness(
        steps=sum(one.steps for one in nodes),
        p50=largest("p50"),
        p99=largest("p99"),
        p999=largest("p999"),
    )
