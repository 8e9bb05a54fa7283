"""A model that answers from a list, a function or a seed: for tests and `--model mock`."""

from __future__ import annotations

import hashlib
import random
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum

from robotouille_evaluation.models.model import (
    Completion,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)
from robotouille_evaluation.models.valid_actions import valid_actions

__all__ = ["MOCK_KINDS", "AnswerForm", "AnswerKind", "Scripted", "ScriptedModel", "SeededAnswers"]

Scripted = str | Completion | ModelError
"""What a script answers: a text, or all of a completion, or an error that is raised."""


class AnswerKind(StrEnum):
    """What an answer by a seed is like."""

    PLAN = "plan"
    """The next step of a plan; a random valid action where there is no plan."""
    RANDOM = "random"
    """A random valid action."""
    WRONG_CASE = "wrong-case"
    """A valid action in capitals."""
    FULL_STOP = "full-stop"
    """A valid action and a full stop."""
    SEVERAL = "several"
    """Two actions, each in a line of its own."""
    IMPOSSIBLE = "impossible"
    """What looks like an action and is none."""
    NO_ACTION = "no-action"
    """Reasoning alone."""
    OTHER_LANGUAGE = "other-language"
    EMPTY = "empty"
    """No text, which is an error as at an endpoint."""


MOCK_KINDS: Mapping[AnswerKind, float] = {
    AnswerKind.PLAN: 12,
    AnswerKind.RANDOM: 3,
    AnswerKind.WRONG_CASE: 1,
    AnswerKind.FULL_STOP: 1,
    AnswerKind.SEVERAL: 1,
    AnswerKind.IMPOSSIBLE: 1,
    AnswerKind.NO_ACTION: 1,
}
"""How often `--model mock` gives answers of each kind, in relation to each other."""


class AnswerForm(StrEnum):
    """In which form an answer is asked for."""

    STEP = "step"
    """Reasoning and one action."""
    PLAN = "plan"
    """All actions below `Plan:`."""
    CHAIN = "chain"
    """All actions, each with what it changes."""
    JOINT = "joint"
    """Reasoning, and below `Actions:` a line for each robot that is asked for."""

    @classmethod
    def asked_for(cls, request: ModelRequest) -> AnswerForm:
        """By the headings in the instructions, or, if these name none, in the examples."""
        for role in ("user", "assistant"):
            first = next((m.content for m in request.messages if m.role == role), "")
            headings = {line.partition(":")[0] for line in first.splitlines() if ":" in line}
            if {"Reasoning", "Actions"} <= headings:
                return cls.JOINT
            if "Reasoning" in headings:
                return cls.STEP
            if "Plan" in headings:
                return cls.PLAN
            if "Action" in headings:
                return cls.CHAIN
        return cls.STEP


class ScriptedModel:
    """A model that answers what a function says, at once and for nothing.

    Tokens are counted as words.

    Args:
        answer: Gives the answer to a request.
        name: What the model is called.
    """

    def __init__(self, answer: Callable[[ModelRequest], Scripted], name: str = "mock") -> None:
        self.name = name
        self._answer = answer

    @classmethod
    def of(cls, answers: Iterable[Scripted], name: str = "mock") -> ScriptedModel:
        """A model that gives these answers one after the other, and then none any more."""
        coming = iter(answers)
        over = ModelError(ModelErrorKind.EMPTY, "the script has no further answer")
        return cls(lambda _: next(coming, over), name)

    async def complete(self, request: ModelRequest) -> Completion:
        """What the script answers.

        Args:
            request: What the function is asked.

        Raises:
            ModelError: If that is what the script says.
        """
        answer = self._answer(request)
        if isinstance(answer, ModelError):
            raise answer
        if isinstance(answer, Completion):
            return answer
        sent = sum(len(message.content.split()) for message in request.messages)
        return Completion(answer, Usage(sent, len(answer.split())))


class SeededAnswers:
    """Answers by a seed: plan steps, random valid actions and flawed answers.

    The same conversation gets the same answers in the same order, whatever is asked between. So
    that an episode can be repeated, each has one of its own.

    Args:
        seed: Decides all of them.
        kinds: What answers are like, and how often in relation to each other.
        plan: The next action in the state that a request describes, or None.
    """

    def __init__(
        self,
        seed: int,
        kinds: Mapping[AnswerKind, float] = MOCK_KINDS,
        plan: Callable[[ModelRequest], str | None] = lambda _: None,
    ) -> None:
        self._seed = seed
        self._kinds = dict(kinds)
        self._plan = plan
        self._asked: Counter[bytes] = Counter()

    def __call__(self, request: ModelRequest) -> Scripted:
        """The answer to a request in the form that it asks for, or what its kind makes of it.

        Args:
            request: Its last observation says what is valid.
        """
        rng = random.Random(self._draw(request))
        actions = valid_actions(request)
        if not actions:
            return "Reflection: Next time I shall start first what takes long."
        kind = rng.choices(list(self._kinds), list(self._kinds.values()))[0]
        form = AnswerForm.asked_for(request)
        asked = _by_robot(actions) if form is AnswerForm.JOINT else {"": actions}
        chosen = {robot: rng.choice(own) for robot, own in asked.items()}
        if kind is AnswerKind.PLAN and (planned := self._plan(request)):
            chosen[_robot(planned) if form is AnswerForm.JOINT else ""] = planned
        return written(kind, tuple(chosen.values()), rng.choice(actions), form)

    def _draw(self, request: ModelRequest) -> str:
        digest = hashlib.sha256()
        for message in request.messages:
            for part in (message.role, message.content):
                digest.update(part.encode(errors="replace") + b"\0")
        key = digest.digest()
        self._asked[key] += 1
        return f"{self._seed}:{digest.hexdigest()}:{self._asked[key]}"


def _robot(line: str) -> str:
    """Whose action a line of a joint answer is."""
    return line.partition(": ")[0]


def _by_robot(lines: Iterable[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in lines:
        found.setdefault(_robot(line), []).append(line)
    return found


def _wish(line: str, form: AnswerForm) -> str:
    """An action in the middle of a sentence, without the robot's name before it."""
    action = line.partition(": ")[2] if form is AnswerForm.JOINT else line
    return f"{action[:1].lower()}{action[1:]}"


def written(
    kind: AnswerKind, chosen: Sequence[str], other: str, form: AnswerForm = AnswerForm.STEP
) -> Scripted:
    """An answer of a kind and form around an action, or around those of several robots."""
    if kind is AnswerKind.EMPTY:
        return ModelError(ModelErrorKind.EMPTY, "an answer without text")
    wishes = ", and to ".join(_wish(line, form) for line in chosen)
    reasoning = f"Reasoning: I think that it is best to {wishes}."
    if kind is AnswerKind.NO_ACTION:
        return reasoning
    if kind is AnswerKind.OTHER_LANGUAGE:
        return "Begründung: Das Beste ist nun dies.\nHandlung: " + "\n".join(chosen)
    said = {
        AnswerKind.WRONG_CASE: [line.upper() for line in chosen],
        AnswerKind.FULL_STOP: [f"{line}." for line in chosen],
        AnswerKind.SEVERAL: [*chosen, other],
        AnswerKind.IMPOSSIBLE: [f"{line} and then to the moon" for line in chosen],
    }.get(kind, chosen)
    if form is AnswerForm.PLAN:
        return "\n".join(["Plan:", *said])
    if form is AnswerForm.JOINT:
        return "\n".join([reasoning, "Actions:", *said])
    headed = [f"Action: {each}" for each in said]
    if form is AnswerForm.CHAIN:
        return "\n".join(f"{line}\nThen: it is done" for line in headed)
    return "\n".join([reasoning, *headed])
