"""Models in real time: cost of thinking, late answers, and helpers that act in the meantime."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_evaluation.realtime.observation import (
        Charge,
        ChargeKind,
        LatePolicy,
        ObservedStep,
        digest,
        estimated_tokens,
        still_holds,
    )
    from robotouille_evaluation.realtime.seat import RealTimeSeat, SeatDecision
    from robotouille_evaluation.realtime.thoughts import Thought
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille_evaluation.realtime.seat",
        "robotouille_evaluation.realtime.observation",
    )

__all__ = [
    "Charge",
    "ChargeKind",
    "LatePolicy",
    "ObservedStep",
    "RealTimeSeat",
    "SeatDecision",
    "Thought",
    "digest",
    "estimated_tokens",
    "still_holds",
]
