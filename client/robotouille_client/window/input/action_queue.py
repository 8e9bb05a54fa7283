"""Queue of a player's inputs: one action is sent, the others wait."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.work import Occupancy
from robotouille.world.scene import scene
from robotouille.world.unmet import Unmet
from robotouille_client.window.input.commands import Command
from robotouille_client.window.input.controls import ResolvedInput, facts_after, handled
from robotouille_client.window.input.foresight import Meaning, foreseen, meaning
from robotouille_client.window.view import Bubble, GameSource, View

MAX_QUEUED = 3
QUICK_SECONDS = 0.4
"""Time after an action during which a new input is queued. A later input replaces the action."""
SHOWN_SECONDS = 0.5
"""Time for which the result of an action is marked."""
GUARD_SECONDS = 1.0
"""Time after an action in which the use key does not undo it."""
CHANGED = "Something changed here in the meantime, so {} did nothing"
"""Notice for an input that would now do something else than when it was given."""
PATIENCE_SECONDS = 6.0
"""Time for which a walk to an occupied station is retried.

Cutting takes about three seconds, after which most players leave.
"""
LATE_SECONDS = 2.0
"""Time after which a walk that has not begun counts as rejected."""
UNREACHED = "You didn't get there, so nothing was done"
"""Notice for an action that was meant for the end of a walk that failed."""
STILL_OCCUPIED = "It is still occupied, so you stopped waiting for it"
"""Notice for a walk to a station that did not become free in time."""


def _nothing(resolved: ResolvedInput, view: View) -> str:
    return ""


@dataclass(frozen=True, slots=True)
class Intent:
    """Input that is resolved to an action when its turn comes.

    Attributes:
        follows: True if the input is meant for the station that the walk before it leads to.
        action: The action, if it does not depend on the state.
        commands: The directions of a walk.
        extend: Function that adds the directions of a further walk; None if there are too many.
        declined: Returns why the action is not sent when its turn comes, or "".
        meant: Meaning of the input when it began to wait; None if it had none.
    """

    label: str
    resolve: Callable[[View], ResolvedInput]
    follows: bool = False
    action: GroundAction | None = None
    commands: tuple[Command, ...] = ()
    extend: Callable[[Intent], Intent | None] | None = None
    declined: Callable[[ResolvedInput, View], str] = _nothing
    meant: Meaning | None = None


@dataclass(frozen=True, slots=True)
class _Retry:
    """Walk to an occupied station that is retried until a time in seconds."""

    label: str
    action: GroundAction
    until: float

    @property
    def words(self) -> str:
        """Label in the list of waiting actions."""
        return f"{self.label} (occupied)"


@dataclass(frozen=True, slots=True)
class Sent:
    """The last action that was sent.

    Attributes:
        time: When it was sent, or when its result was known.
        handled: Things that it takes up or puts down; none if it is work such as cutting.
    """

    action: GroundAction
    time: float
    step: int
    bubble: Bubble | None
    handled: frozenset[str]
    fate: Literal["asked", "done", "rejected"] = "asked"


class ActionQueue:
    """Queue that sends one action at a time."""

    def __init__(self, clock: Callable[[], float], *, foresees: bool = True) -> None:
        self._clock = clock
        self._foresees = foresees
        self._waiting: list[Intent] = []
        self._sent: Sent | None = None
        self._label = ""
        self._retry: _Retry | None = None
        self._failed_at: float | None = None
        self._ticked_at = clock()
        self._untold = ""

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the waiting actions, the next one first."""
        first = () if self._retry is None else (self._retry.words,)
        return (*first, *(intent.label for intent in self._waiting))

    @property
    def sent(self) -> Sent | None:
        """The last action, until shortly after its result is known."""
        sent = self._sent
        if sent is None or (sent.fate != "asked" and self._clock() - sent.time > SHOWN_SECONDS):
            return None
        return sent

    @property
    def awaited(self) -> str | None:
        """Station that the player walks to as soon as another player leaves it."""
        return None if self._retry is None else self._retry.action.destination

    def just_used(self, repeats: bool) -> frozenset[str]:
        """Return the objects that the use key must leave, because it would undo the last action.

        Args:
            repeats: True shortly after another press. Only then, taking up what the player has
                worked on counts as one press too many: it is the natural next action.
        """
        sent = self._sent
        if sent is None or sent.fate != "done" or sent.action.destination is not None:
            return frozenset()
        if self._clock() - sent.time >= GUARD_SECONDS:
            return frozenset()
        return sent.handled or frozenset(sent.action.arguments if repeats else ())

    @property
    def idle(self) -> bool:
        """True if no action is queued or awaits its result."""
        return not self.labels and (self._sent is None or self._sent.fate != "asked")

    def clear(self) -> bool:
        """Drop the waiting actions and return whether there were any."""
        had = bool(self.labels)
        self._forget()
        return had

    def ask(self, intent: Intent, source: GameSource, view: View) -> str:
        """Send an input's action now or queue it; return a notice for the player, or "".

        An input that follows a walk waits until the walk has succeeded. It does nothing if the walk
        failed a moment ago. Any other input replaces a walk that is being retried.
        """
        if view.frozen or view.me is None:
            return ""
        if view.lobby is not None and view.starts_in is None:
            return "The game hasn't started yet"
        self._settle(view)
        asked = self._sent if self._sent is not None and self._sent.fate == "asked" else None
        walks = asked is not None and asked.action.destination is not None
        if asked is not None and intent.action == asked.action and not _repeats(asked.action, view):
            return ""  # A second choice of the same action, while the first one is under way.
        if intent.follows and (walks or self._retry is not None):
            return self._wait(intent, view)
        if intent.follows and self._just_failed:
            return UNREACHED
        self._failed_at = None
        # The player has changed their mind about the occupied station.
        if self._retry is not None:
            self._forget()
        busy = bool(view.state.busy_steps(view.me)) or view.starts_in is not None
        # A quick second press is meant for afterwards. A later one replaces the first action.
        just_sent = asked is not None and self._clock() - asked.time < QUICK_SECONDS
        if not (busy or just_sent or self._waiting):
            return self._do(intent, source, view)
        return self._wait(intent, view)

    def tick(self, source: GameSource, view: View) -> str:
        """Send the next action if possible; return a notice for the player, or ""."""
        self._be_patient(view)
        self._settle(view)
        if view.over:
            self.clear()
        notice = self._send_next(source, view) if self._may_send(view) else ""
        untold, self._untold = self._untold, ""
        return notice or untold

    def _be_patient(self, view: View) -> None:
        """Stop the time of a retried walk while the game is paused."""
        now = self._clock()
        if view.frozen and self._retry is not None:
            until = self._retry.until + now - self._ticked_at
            self._retry = dataclasses.replace(self._retry, until=until)
        self._ticked_at = now

    def _may_send(self, view: View) -> bool:
        """Return whether the player can act now and awaits no result."""
        if view.frozen or view.me is None or view.starts_in is not None:
            return False
        if self._sent is not None and self._sent.fate == "asked":
            return False
        return not view.state.busy_steps(view.me)

    def _send_next(self, source: GameSource, view: View) -> str:
        if self._retry is not None:
            self._try_again(self._retry, source, view)
            return ""
        return self._do(self._waiting.pop(0), source, view) if self._waiting else ""

    def _wait(self, intent: Intent, view: View) -> str:
        # Directions that wait become one walk, which does not stop at the stations on the way.
        last = self._waiting[-1] if self._waiting else None
        if last is not None and last.extend is not None and intent.commands:
            longer = last.extend(intent)
            if longer is not None:
                self._waiting[-1] = longer
                return ""
        if len(self._waiting) >= MAX_QUEUED:
            return f"{MAX_QUEUED} actions are queued already"
        meant = self._meant(intent, view) if intent.follows and self._foresees else None
        self._waiting.append(dataclasses.replace(intent, meant=meant))
        return ""

    def _meant(self, intent: Intent, view: View) -> Meaning | None:
        """Return what an input means after those before it, if nobody else acts until then."""
        me, first = view.me or "", None
        if self._retry is not None:
            first = self._retry.action
        elif self._sent is not None and self._sent.fate == "asked":
            first = self._sent.action
        then = dataclasses.replace(view, state=foreseen(view.state, me, first))
        for earlier in self._waiting:
            action = earlier.resolve(then).action
            if action is None:
                return None
            then = dataclasses.replace(then, state=foreseen(then.state, me, action))
        action = intent.resolve(then).action
        return None if action is None else meaning(then.state, me, action)

    def _forget(self) -> None:
        self._waiting, self._retry = [], None

    @property
    def _just_failed(self) -> bool:
        """True for a moment after a walk has failed."""
        return self._failed_at is not None and self._clock() - self._failed_at < GUARD_SECONDS

    def _fail(self, action: GroundAction, notice: str = "") -> None:
        """Drop what was meant to follow an action that was rejected for good.

        Args:
            notice: Notice if nothing was meant to follow it.
        """
        if action.destination is not None:
            self._failed_at = self._clock()
            followed = any(intent.follows for intent in self._waiting)
            # A later failure without words must not hide an earlier notice.
            self._untold = (UNREACHED if followed else notice) or self._untold
        self._forget()

    def _do(self, intent: Intent, source: GameSource, view: View) -> str:
        resolved = intent.resolve(view)
        if resolved.action is None:
            # The waiting inputs were meant to follow this action.
            self._waiting = []
            return capitalised(resolved.hint)
        meant = intent.meant
        if meant is not None and meaning(view.state, view.me or "", resolved.action) != meant:
            self._waiting = []
            return CHANGED.format(intent.label)
        if why := intent.declined(resolved, view):
            self._waiting = []
            return capitalised(why)
        self._label = intent.label
        self._send(resolved.action, source, view)
        return ""

    def _send(self, action: GroundAction, source: GameSource, view: View) -> None:
        things = handled(view.state, view.me or "", action)
        self._sent = Sent(action, self._clock(), view.step, _bubble(view), things)
        source.act(action)

    def _try_again(self, retry: _Retry, source: GameSource, view: View) -> None:
        """Retry the walk if the station is free; give up when the time has passed."""
        if self._clock() > retry.until:
            self._fail(retry.action, STILL_OCCUPIED)
        elif view.me is not None and retry.action in view.state.actions(view.me):
            self._send(retry.action, source, view)

    def _wanted(self, sent: Sent, view: View) -> _Retry | None:
        """Return the retry of a rejected walk if only another player was in the way."""
        if sent.action.destination is None:
            return None
        unmet = view.world.unmet(view.state, sent.action)
        # The other player may have left since then. If nothing has changed, the reason is another.
        gone = not unmet and view.step > sent.step and self._retry is None
        if not (gone or _is_in_the_way(unmet, view)):
            return None
        if self._retry is not None and self._retry.action == sent.action:
            return self._retry
        return _Retry(self._label, sent.action, self._clock() + PATIENCE_SECONDS)

    def _settle(self, view: View) -> None:
        """Record the result of the action that was sent."""
        sent = self._sent
        if sent is None or sent.fate != "asked":
            return
        now, bubble = self._clock(), _bubble(view)
        fate: Literal["asked", "done", "rejected"] = "asked"
        # A rejection shows as a new bubble. The old bubble is about an earlier action.
        if bubble is not None and bubble is not sent.bubble:
            fate = "rejected"
        elif view.step > sent.step:
            fate = "done" if _has_arrived(sent.action, view) else self._fate_of_walk(sent, view)
        if fate == "done":
            self._retry = None
        elif fate == "rejected":
            self._retry = self._wanted(sent, view)
            if self._retry is None:
                self._fail(sent.action)
        if fate != "asked":
            self._sent = dataclasses.replace(sent, time=now, bubble=bubble, fate=fate)

    def _fate_of_walk(self, sent: Sent, view: View) -> Literal["asked", "rejected"]:
        """Return the fate of a walk that has not begun although a step has passed."""
        # Another player may have taken the station in the same step, which is not reported. On a
        # server, a later step may apply the walk.
        taken = _is_in_the_way(view.world.unmet(view.state, sent.action), view)
        late = self._clock() - sent.time > LATE_SECONDS
        return "rejected" if taken or late else "asked"


def _repeats(action: GroundAction, view: View) -> bool:
    """Return whether an action can be done again at once, such as cutting."""
    return facts_after(view.state, action) & action.tested == action.required


def _has_arrived(action: GroundAction, view: View) -> bool:
    """Return whether a walk has begun or ended. Actions that are not walks count as arrived."""
    me = view.me or ""
    if action.destination is None or view.state.busy_steps(me):
        return True
    return scene(view.state)[me].at == action.destination


def _is_in_the_way(unmet: Sequence[Unmet], view: View) -> bool:
    """Return whether only other players, who move away after a while, prevent an action."""
    occupancy = Occupancy(view.world)
    return bool(unmet) and all(occupancy.needed_free(each) is not None for each in unmet)


def _bubble(view: View) -> Bubble | None:
    """Return the bubble that shows why the local player's last action was rejected."""
    own = (b for b in view.bubbles if b.player == view.me and b.kind == "rejected")
    return next(own, None)
