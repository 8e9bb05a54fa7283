"""Who makes a request to the operator's port, and what they may see and do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus

from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.auth import RoleGrant, same_episode

__all__ = ["LOCAL", "Principal"]

LOCAL = "local"
"""What a program on this machine that needs no token is called in the audit log."""


def _always() -> None:
    """Who has shown no token has none that could expire."""


@dataclass(frozen=True, slots=True)
class Principal:
    """`grant` is what the token says, None for a program that needs none; `judge` raises
    RequestRefusedError once the token does not hold any longer."""

    grant: RoleGrant | None = None
    judge: Callable[[], object] = field(default=_always, repr=False)

    @property
    def name(self) -> str:
        """What the principal is called in the audit log."""
        return LOCAL if self.grant is None else self.grant.subject

    @property
    def token_subject(self) -> str | None:
        """Whose token it is; None where there is none."""
        return None if self.grant is None else self.grant.subject

    @property
    def token_id(self) -> str:
        """Which token it is; empty where there is none, or it has no id."""
        return "" if self.grant is None else self.grant.token_id

    @property
    def only(self) -> str:
        """The id or code of the only episode the token is for; empty for all."""
        return "" if self.grant is None else self.grant.episode

    def may_see(self, *names: str) -> bool:
        """Whether an episode with these names (its id, its code) is this principal's business."""
        return not self.only or any(same_episode(self.only, name) for name in names)

    def check(self, *names: str) -> None:
        """RequestRefusedError unless `may_see`."""
        if not self.may_see(*names):
            message = f"your token is for the episode {self.only} only"
            raise RequestRefusedError(HTTPStatus.FORBIDDEN, "auth/episode", message)
