"""The values that models and agents exchange."""

from __future__ import annotations

import copy
import pickle

from robotouille.errors import RobotouilleError
from robotouille_evaluation.models import (
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)


def test_usage_adds_up() -> None:
    assert Usage(1, 2) + Usage(3, 4) == Usage(4, 6, None)
    assert Usage(1, 2, 0.5) + Usage(3, 4) == Usage(4, 6, 0.5)
    assert Usage(cost=0.5) + Usage(cost=0.25) == Usage(cost=0.75)


def test_requests_are_values() -> None:
    one = ModelRequest((Message("user", "hi"),), parameters={"seed": 1})
    other = ModelRequest((Message("user", "hi"),), parameters={"seed": 1})
    assert one == other and hash(one) == hash(other) and one.purpose == "propose"
    assert ModelRequest(()).parameters == {}


def test_errors_say_what_happened_and_travel_between_processes() -> None:
    error = ModelError(
        ModelErrorKind.SERVER, "status 500: no", retry_may_help=True, status=500
    ).after(3, Usage(1, 2, 0.5))
    assert isinstance(error, RobotouilleError)
    assert str(error) == "server: status 500: no (3 attempts)"
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert str(twin) == str(error) and vars(twin) == vars(error)
