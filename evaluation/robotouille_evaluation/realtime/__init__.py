"""Models in real time: what thinking costs, what becomes of late answers, who acts meanwhile."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_evaluation.realtime.changes import digest, estimated_tokens
    from robotouille_evaluation.realtime.charge import Charge, ChargeKind
    from robotouille_evaluation.realtime.late import Late, Look, holds
    from robotouille_evaluation.realtime.seat import Choice, RealTimeSeat
    from robotouille_evaluation.realtime.thoughts import Thought
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille_evaluation.realtime.thoughts",
        "robotouille_evaluation.realtime.changes",
        "robotouille_evaluation.realtime.late",
        "robotouille_evaluation.realtime.charge",
        "robotouille_evaluation.realtime.seat",
    )

__all__ = [
    "Charge",
    "ChargeKind",
    "Choice",
    "Late",
    "Look",
    "RealTimeSeat",
    "Thought",
    "digest",
    "estimated_tokens",
    "holds",
]
