"""Values that models and agents exchange."""

from __future__ import annotations

import copy
import pickle

from robotouille.errors import RobotouilleError
from robotouille_evaluation.models import ModelError, ModelErrorKind, Usage


def test_usage_adds_up() -> None:
    assert Usage(1, 2) + Usage(3, 4) == Usage(4, 6, None)
    assert Usage(1, 2, 0.5) + Usage(3, 4) == Usage(4, 6, 0.5)
    assert Usage(cost=0.5) + Usage(cost=0.25) == Usage(cost=0.75)


def test_errors_survive_pickling() -> None:
    error = ModelError(ModelErrorKind.SERVER, "status 500: no", retry_may_help=True)
    error.in_total(3, Usage(1, 2, 0.5))
    assert isinstance(error, RobotouilleError)
    assert str(error) == "server: status 500: no (3 attempts)"
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert str(twin) == str(error) and vars(twin) == vars(error)
