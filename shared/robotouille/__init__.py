"""Robotouille: a kitchen with time delays, as a Markov decision process without any I/O.

import robotouille

world = robotouille.World("synchronous/01_cheese_sandwich")
state = world.initial
for action in state.actions("robot1"):
    print(action.sentence, state.step(action).goal_reached)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.certification.certificate import Certificate, load_certificate
    from robotouille.domain.loading import load_task, task_names
    from robotouille.domain.task import Task, Timing
    from robotouille.errors import (
        Fault,
        FileError,
        InapplicableError,
        ProtocolError,
        RecordingError,
        RobotouilleError,
        SlotOverflowError,
        UnknownNameError,
        UnknownTaskError,
        WrongArgumentError,
        WrongWorldError,
    )
    from robotouille.world.grounding.actions import GroundAction
    from robotouille.world.sight import Seen, Sight, seen_by
    from robotouille.world.timers import Progress
    from robotouille.world.unmet import Attempt
    from robotouille.world.world import State, Step, World
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.errors",
        "robotouille.domain.task",
        "robotouille.domain.loading",
        "robotouille.world.grounding.actions",
        "robotouille.world.sight",
        "robotouille.world.timers",
        "robotouille.world.unmet",
        "robotouille.world.world",
        "robotouille.certification.certificate",
    )

__all__ = [
    "Attempt",
    "Certificate",
    "Fault",
    "FileError",
    "GroundAction",
    "InapplicableError",
    "Progress",
    "ProtocolError",
    "RecordingError",
    "RobotouilleError",
    "Seen",
    "Sight",
    "SlotOverflowError",
    "State",
    "Step",
    "Task",
    "Timing",
    "UnknownNameError",
    "UnknownTaskError",
    "World",
    "WrongArgumentError",
    "WrongWorldError",
    "load_certificate",
    "load_task",
    "seen_by",
    "task_names",
]
