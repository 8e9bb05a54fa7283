"""Bots that use the client library."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.policies import Policy, RandomPolicy
    from robotouille_client.bots.seat_policy import play
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.policies.policy",
        "robotouille_client.bots.seat_policy",
    )

__all__ = ["Policy", "RandomPolicy", "play"]
