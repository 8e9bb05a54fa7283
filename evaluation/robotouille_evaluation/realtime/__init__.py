"""Models in real time: what thinking costs, what becomes of late answers, who acts meanwhile."""

from robotouille_evaluation.realtime.charge import Charge, ChargeKind
from robotouille_evaluation.realtime.digest import digest, estimated_tokens
from robotouille_evaluation.realtime.late import Late, Look, holds
from robotouille_evaluation.realtime.seat import Choice, RealTimeSeat

__all__ = [
    "Charge",
    "ChargeKind",
    "Choice",
    "Late",
    "Look",
    "RealTimeSeat",
    "digest",
    "estimated_tokens",
    "holds",
]
