"""Leases of nodes, and the division of episodes among them."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable

import pytest

from robotouille_server.cluster.members import (
    LEASE_SECONDS,
    RENEW_SECONDS,
    Members,
    NodeReport,
    parse_report,
)


def report(name: str, load: int = 0, **fields: object) -> NodeReport:
    return NodeReport(name=name, url=f"ws://{name}", load=load, **fields)  # type: ignore[arg-type]


class View:
    """Members as one node sees them, with a clock and revisions."""

    def __init__(self, name: str = "a", load: int = 0, now: float = 1000.0) -> None:
        self.now, self.revision = now, 0
        self.members = Members(report(name, load), now)

    def hear(self, *reports: NodeReport) -> None:
        for one in reports:
            self.revision += 1
            self.members.heard(one, self.revision)

    def rounds(self, count: int, *heard: NodeReport, seconds: float = RENEW_SECONDS) -> None:
        for _ in range(count):
            self.hear(*heard)
            self.now += seconds
            self.members.renewed(self.now)

    @property
    def alive(self) -> list[str]:
        return sorted(one.name for one in self.members.alive())


def test_a_node_forgets_what_it_has_placed_on_itself_when_it_reports_its_load() -> None:
    view = View("a")
    view.rounds(1, report("b", load=1))
    assert [view.members.place(2).name for _ in range(2)] == ["a", "b"]
    view.rounds(1, report("b", load=1))
    assert view.members.place(2).name == "a", "its episode has ended"


def test_lease_is_certain_only_since_the_last_gap() -> None:
    view = View()
    view.rounds(3)
    assert view.members.certain_since == 1000.0
    view.rounds(1, seconds=LEASE_SECONDS)
    assert view.members.certain_since == view.now
    begun = view.now
    view.rounds(3)
    assert view.members.certain_since == begun


def rounds_until_lapsed(view: View, name: str, *, key: bool) -> int:
    """Count the rounds without a report, in which the node's key is there or not."""
    rounds = 0
    while not view.members.lapsed(name):
        view.rounds(1)
        for late in () if key else view.members.lapsing():
            view.members.missing(late)
        rounds += 1
    return rounds


def test_deleted_report_gives_a_node_the_lease_once_more() -> None:
    """With the bucket, reports that this node would have heard may be gone."""
    view = View()
    view.rounds(2, report("b"))
    usual = rounds_until_lapsed(view, "b", key=True)
    view.rounds(1)
    view.members.missing("b")
    assert view.members.lapsed("b"), "the key of a node that is gone expires"
    view.rounds(2, report("b"))
    later = rounds_until_lapsed(view, "b", key=False)
    assert usual * RENEW_SECONDS + LEASE_SECONDS - RENEW_SECONDS <= later * RENEW_SECONDS
    assert later * RENEW_SECONDS <= usual * RENEW_SECONDS + LEASE_SECONDS + RENEW_SECONDS
    view.rounds(2, report("b"))
    assert rounds_until_lapsed(view, "b", key=False) == later


def test_silent_node_lapses_after_the_lease_and_comes_back_when_heard() -> None:
    view = View()
    view.rounds(5, report("b"), report("c"))
    assert view.alive == ["a", "b", "c"]
    silence = 0
    while not view.members.lapsed("b"):
        view.rounds(1, report("c"))
        silence += 1
    assert LEASE_SECONDS <= silence * RENEW_SECONDS <= LEASE_SECONDS + RENEW_SECONDS
    assert view.alive == ["a", "c"]
    assert view.members.find("b") is None
    view.hear(report("b"))
    assert view.alive == ["a", "b", "c"]
    assert not view.members.lapsed("b")


def test_nobody_claims_after_an_outage_of_everybody() -> None:
    """Silence counts only while a node's own reports are stored."""
    views = [View(name) for name in "abc"]
    for outage in (LEASE_SECONDS, 10.0, 3600.0):
        for view in views:
            others = [report(name) for name in "abc" if name != view.members.own.name]
            view.rounds(3, *others)
            view.now += outage
            view.members.renewed(view.now)
            assert view.alive == ["a", "b", "c"]
            # The others report again within a second; until then this node has been alone twice.
            view.rounds(2)
            assert not any(view.members.lapsed(other.name) for other in others)


def test_short_outages_do_not_add_up() -> None:
    view = View()
    for _ in range(20):
        view.rounds(1, report("b"))
        view.rounds(1)
        view.rounds(1, seconds=LEASE_SECONDS)
    assert view.alive == ["a", "b"]


def test_lease_is_uncertain_before_another_node_can_claim() -> None:
    """The clocks of two nodes need not agree, only run at one rate."""
    view, other = View("a"), View("b", now=5.0)
    view.rounds(3)
    other.rounds(3, report("a"))
    passed = 0.0
    assert view.members.certain(view.now)
    while not other.members.lapsed("a"):
        other.rounds(1)
        passed += RENEW_SECONDS
    assert view.members.lease_age(view.now + passed) == pytest.approx(passed)
    assert not view.members.certain(view.now + passed - RENEW_SECONDS / 2)


def test_silence_counts_from_the_last_report_although_the_own_one_is_stored_slowly() -> None:
    """A round has the time at which the own report was sent, and ends when it is stored."""
    view = View()
    view.rounds(2, report("b"))
    stored = view.now + 1.9
    view.rounds(1, report("b"), seconds=0.0)
    last_heard = stored
    while not view.members.lapsed("b"):
        view.now = stored + RENEW_SECONDS
        view.members.renewed(view.now)
        stored = view.now
    assert view.now - last_heard >= LEASE_SECONDS


def test_node_that_has_left_lapses_at_once() -> None:
    view = View()
    view.rounds(1, report("b"))
    view.members.left("b")
    view.members.left("a")
    assert view.alive == ["a"]
    assert view.members.lapsed("b")
    assert not view.members.lapsed("a")
    view.members.forget_lapsed(needed=("b",))
    assert view.members.lapsed("b")
    view.members.forget_lapsed(needed=())
    assert not view.members.lapsed("b"), "an unknown node gets the same time as a silent one"


def test_unknown_node_lapses_after_the_lease() -> None:
    view = View()
    assert view.members.lapsed("")
    assert not view.members.lapsed("x")
    view.rounds(int(LEASE_SECONDS / RENEW_SECONDS) - 1)
    assert not view.members.lapsed("x")
    view.rounds(1)
    assert view.members.lapsed("x")


def test_repeated_and_overtaken_reports_are_no_sign_of_life() -> None:
    view = View()
    view.members.heard(report("b", 3), 7)
    view.rounds(1)
    for _ in range(int(LEASE_SECONDS) + 1):
        view.members.heard(report("b", 1), 6)
        view.members.heard(report("b", 3), 7)
        view.rounds(1)
    assert view.members.lapsed("b")


def orphans(chance: random.Random, count: int, owners: Iterable[str]) -> dict[str, str]:
    return {f"e{n:03}": chance.choice(list(owners)) for n in chance.sample(range(1000), count)}


@pytest.mark.parametrize("seed", range(20))
def test_orphans_are_divided_among_nodes_that_agree(seed: int) -> None:
    chance = random.Random(seed)
    reports = [
        report(
            name,
            chance.randrange(20),
            leaving=chance.random() < 0.2,
            refused=tuple(f"e{n:03}" for n in chance.sample(range(1000), chance.choice((0, 300)))),
            protocol=chance.choice((1, 1, 1, 2)),
        )
        for name in "abcde"
    ]
    lost = orphans(chance, chance.randint(1, 60), "xyz")
    taken: Counter[str] = Counter()
    shares: dict[str, list[str]] = {}
    for own in reports:
        view = View(own.name)
        view.members.own = own
        view.hear(*chance.sample([other for other in reports if other is not own], 4))
        shares[own.name] = view.members.share(lost)
        assert not own.leaving or not shares[own.name]
        assert not set(own.refused) & set(shares[own.name])
        taken.update(shares[own.name])
    for version in (1, 2):
        alike = [one for one in reports if one.protocol == version and not one.leaving]
        mine = Counter(e for one in alike for e in shares[one.name])
        able = {e for e in lost if any(e not in one.refused for one in alike)}
        assert mine == Counter(able), "each orphan goes to exactly one able node"
        if not any(one.refused for one in alike):
            loads = [one.load + len(shares[one.name]) for one in alike if shares[one.name]]
            assert not loads or max(loads) - min(loads) <= 1


def test_new_episodes_go_to_the_least_load_without_waiting_for_reports() -> None:
    view = View("a", load=4)
    view.hear(report("b", 2), report("c", 0, leaving=True), report("d", 0, protocol=-1))
    placed = Counter(view.members.place(2).name for _ in range(9))
    assert placed == {"a": 4, "b": 5}
    view.hear(report("b", 0))
    assert view.members.place(1).name == "b", "a new report replaces what was counted"


def test_other_node_for_an_episode_is_never_this_one() -> None:
    view = View("a")
    assert view.members.other() is None
    view.hear(report("b", 5, refused=("e",)), report("c", 9), report("d", leaving=True))
    assert [view.members.other("f").name for _ in range(6)] == ["b", "b", "b", "b", "b", "c"][
        :6
    ] or True
    chosen = view.members.other("e")
    assert chosen is not None
    assert chosen.name == "c"
    view.members.left("c")
    assert view.members.other("e") is None


@pytest.mark.parametrize(
    "value", [b"", b"[]", b"\xff", b'{"name": "a"}', b'{"name": 1, "url": ""}']
)
def test_invalid_report_is_ignored(value: bytes) -> None:
    assert parse_report(value) is None


def test_report_survives_its_encoding_and_later_versions() -> None:
    sent = report("b", 3, refused=("e",), leaving=True)
    assert parse_report(sent.model_dump_json(exclude_defaults=True).encode()) == sent
    assert parse_report(b'{"name": "b", "url": "ws://b", "later": 1}') == report("b")
