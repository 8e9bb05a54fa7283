"""One seat of a recording, as its frames tell of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from robotouille.episode import Controller, RejectionKind
from robotouille.episode.tallies import Activity, activity
from robotouille.replay.notes import controller_after, rejection_kind

__all__ = ["ACTIVITIES", "RecordedSeat"]

ACTIVITIES = ("acted", "busy", "waiting", "idle", "away", "substituted")
NAMES = {each: each.value for each in Activity}


@dataclass(slots=True)
class RecordedSeat:
    """Whose it is and who moves it at present, and what was counted so far.

    `refused` says that something was asked for since the last step and taken into none, `blocked`
    how often that was for nothing but another player at a station. `based` are the actions whose
    basis is recorded, `stale` the steps by which these were late, `work` the applied actions that
    change a thing.
    """

    number: int
    player: str
    name: str = ""
    kind: str = ""
    participant: str = ""
    controller: Controller = Controller.FREE
    refused: bool = False
    blocked: int = 0
    did: dict[str, int] = field(default_factory=lambda: dict.fromkeys(ACTIVITIES, 0))
    lost: int = 0
    invalid: int = 0
    malformed: int = 0
    rejected: int = 0
    said: int = 0
    thinking: int = 0
    based: int = 0
    stale: int = 0
    work: int = 0

    def activity(self, applied: bool | None, busy: bool, others_turn: bool) -> str:
        """What it did with a step, which is counted.

        Args:
            applied: Whether its action was; None if it had none.
            busy: It could not act in the state before.
            others_turn: With the turn clock, it was another's turn.
        """
        found = NAMES[activity(self.controller, applied, busy, self.refused, others_turn)]
        self.did[found] += 1
        return found

    def sit(self, note: Mapping[str, Any]) -> None:
        """A roster note: who it is, and who moves it."""
        if note["name"]:
            self.name, self.kind = note["name"], note["kind"]
            self.participant = note.get("participant", "")
        if not note.get("taken", True):
            self.refused = False
        self.controller = controller_after(note)

    def refuse(self, note: Mapping[str, Any], occupied: frozenset[str]) -> None:
        """Something that it asked for was taken into no step.

        Args:
            occupied: Predicates that say that nobody stands at a station.
        """
        kind = rejection_kind(note)
        self.rejected += 1
        if kind is RejectionKind.SUPERSEDED:
            return
        self.refused = True
        self.invalid += kind is RejectionKind.INVALID
        self.malformed += kind is RejectionKind.MALFORMED
        why = note.get("why", ())
        self.blocked += bool(why) and all(
            each["kind"] == "condition" and each.get("predicate") in occupied for each in why
        )
