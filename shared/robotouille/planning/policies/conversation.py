"""Messages between a planner bot and people: requests, answers and announcements."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property

from robotouille.domain.rendering import Language, language_of
from robotouille.planning.policies.aside import after, held_by, put_down
from robotouille.planning.policies.plan_watch import PlanWatch
from robotouille.planning.policies.policy import Script, Speech
from robotouille.planning.policies.standing import standing_at
from robotouille.planning.policies.team_plan import (
    Assumption,
    missing_action,
    object_in_hand,
    station_in_the_way,
)
from robotouille.planning.policies.team_talk import (
    ANNOUNCED_ACTIONS,
    Talk,
    appeal,
    intention,
    promise,
    refusal,
    request,
    requested,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, Signal, understood
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import Occupancy
from robotouille.world.world import State, World


class Conversation(Talk):
    """Messages between one seat and participants who cannot compute its plans.

    Args:
        words: Words that replace those of the domain.
        silent: True to say nothing.
    """

    def __init__(self, world: World, player: str, words: Language, *, silent: bool) -> None:
        super().__init__(silent=silent)
        self._world = world
        self._player = player
        self._words = words
        self._question = ""

    @cached_property
    def _wording(self) -> Wording:
        return Wording(self._world, language_of(self._world.task).with_words(self._words))

    @cached_property
    def _rules(self) -> Occupancy:
        return Occupancy(self._world)

    def meaning(self, speech: Speech, state: State) -> Signal | None:
        """Return the signal of a message, or the one that its text amounts to, if any."""
        if speech.signal is not None:
            return speech.signal
        text, station = speech.text, standing_at(state, self._player)
        if station is not None and requested(text, station, state, self._wording):
            return Signal(Intent.NEED, station)
        signal = understood(text, state, self._wording)
        if signal is None or signal.intent is not Intent.NEED:
            return signal
        # A text names a kind. It means the object in this seat's hand, if that is one.
        kind = state.world.thing(signal.target).kind
        for name in held_by(state, self._player):
            if state.world.thing(name).kind == kind:
                return Signal(Intent.NEED, name)
        return signal

    # Requests

    def ask_for_help(
        self,
        watch: PlanWatch,
        state: State,
        step: int,
        team: Collection[str],
        others: Sequence[str],
    ) -> None:
        """Ask the others for what the plan of a team needs of them, if it is time to ask."""
        if not self.may_ask(step):
            return
        if watch.assumption is Assumption.EVERYBODY and watch.is_stuck:
            missing = missing_action(watch.script, state, others, self._rules)
            if missing is not None and not self._can_do(missing, state, team, others):
                words = appeal(self._here(missing), state, self._wording)
                # To ask for the item in a hand and for an action with it is the same need.
                held = object_in_hand([missing], state, others)
                need = words if held is None else state.world.thing(held).kind
                self.ask(Speech(words), need, step)
                return
        elif watch.assumption is not Assumption.OTHERS_ASIDE:
            return
        coming = watch.script.rest(team)
        needed = object_in_hand(coming, state, others)
        if needed is not None:
            # Wherever the holder walks, the request stays the same.
            self.ask(request(needed), state.world.thing(needed).kind, step, moved=False)
            return
        station = station_in_the_way(coming, state, others)
        if station is not None:
            self.ask(request(station), station, step)

    def _can_do(
        self, action: GroundAction, state: State, team: Collection[str], others: Sequence[str]
    ) -> bool:
        """Return whether one of a team could take another player's action without any help.

        The member may have to walk, and to put down what it holds.
        """
        taken = {standing_at(state, player) for player in others}
        if not taken.isdisjoint(action.arguments):
            return False
        for player in team:
            names = [player if name == action.player else name for name in action.arguments]
            free = state
            for each in put_down(state, player):
                free = after(free, each)
            unmet = free.world.unmet(free, free.world.action(action.name, *names))
            if all(self._rules.is_about_standing(each.predicate) for each in unmet):
                return True
        return False

    # Answers

    def ask_about(self, target: str) -> None:
        """Remember that a participant leaves an object or a station to the team."""
        self._question = target

    def answer(self, script: Script, state: State, team: Collection[str]) -> None:
        """Report what the team is going to do with the thing it was asked about."""
        target, self._question = self._question, ""
        if not target:
            return
        seats = [
            action.player
            for action in script.rest(team)
            if action.destination is None and target in action.arguments
        ]
        if not seats and self._player == min(team):
            self.say(refusal(target, state, self._wording))
        elif seats and seats[0] == self._player:
            actions = [self._here(each) for each in script.rest((self._player,))]
            mine = next(a for a in actions if a.destination is None and target in a.arguments)
            self.say(promise(mine, state, self._wording))

    def announce_script(self, script: Script, state: State, step: int) -> None:
        """Announce the seat's next actions."""
        coming = [self._here(each) for each in script.coming(ANNOUNCED_ACTIONS)]
        self.announce_actions(intention(coming, state, self._wording), step)

    def _here(self, action: GroundAction) -> GroundAction:
        self._world.admit(action.arguments)
        return self._world.action(action.name, *action.arguments)
