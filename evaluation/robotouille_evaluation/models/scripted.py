"""Models that answer from a list, a function or a seed, for tests and `--model mock`."""

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
    valid_actions,
)

Scripted = str | Completion | ModelError
"""Answer of a script: a text, a whole completion, or an error to raise."""


class AnswerKind(StrEnum):
    """Kind of a seeded answer."""

    PLAN = "plan"
    """The next step of a plan, or a random valid action without a plan."""
    RANDOM = "random"
    """A random valid action."""
    WRONG_CASE = "wrong-case"
    """A valid action in capital letters."""
    FULL_STOP = "full-stop"
    """A valid action with a full stop."""
    SEVERAL = "several"
    """Two actions on two lines."""
    IMPOSSIBLE = "impossible"
    """A sentence that looks like an action of the task and is not one."""
    NO_ACTION = "no-action"
    """Reasoning without an action."""
    OTHER_LANGUAGE = "other-language"
    EMPTY = "empty"
    """No text, which is an error as with endpoints."""


MOCK_KINDS: Mapping[AnswerKind, float] = {
    AnswerKind.PLAN: 12,
    AnswerKind.RANDOM: 3,
    AnswerKind.WRONG_CASE: 1,
    AnswerKind.FULL_STOP: 1,
    AnswerKind.SEVERAL: 1,
    AnswerKind.IMPOSSIBLE: 1,
    AnswerKind.NO_ACTION: 1,
}
"""Relative frequencies of kinds of answers with `--model mock`."""


class AnswerForm(StrEnum):
    """Form of answer that a prompt asks for."""

    STEP = "step"
    """Reasoning and one action."""
    PLAN = "plan"
    """All actions below `Plan:`."""
    CHAIN = "chain"
    """All actions, each with its effects."""
    JOINT = "joint"
    """Reasoning, and below `Actions:` a line for each robot in question."""

    @classmethod
    def asked_for(cls, request: ModelRequest) -> AnswerForm:
        """Return the form named by headings in the instructions, or else in the examples."""
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
    """Model that answers with the result of a function, at once and without cost.

    Words count as tokens.

    Args:
        answer: Function from requests to answers.
        name: Name of the model.
    """

    def __init__(self, answer: Callable[[ModelRequest], Scripted], name: str = "mock") -> None:
        self.name = name
        self._answer = answer

    @classmethod
    def of(cls, answers: Iterable[Scripted], name: str = "mock") -> ScriptedModel:
        """Return a model that gives these answers in order, and then raises `ModelError`."""
        coming = iter(answers)
        over = ModelError(ModelErrorKind.EMPTY, "the script has no further answer")
        return cls(lambda _: next(coming, over), name)

    async def complete(self, request: ModelRequest) -> Completion:
        """Return the script's answer, or raise it if it is an error."""
        answer = self._answer(request)
        if isinstance(answer, ModelError):
            raise answer
        if isinstance(answer, Completion):
            return answer
        sent = sum(len(message.content.split()) for message in request.messages)
        return Completion(answer, Usage(sent, len(answer.split())))


class SeededAnswers:
    """Answers drawn from a seed: plan steps, random valid actions and flawed answers.

    The same conversation gets the same answers in the same order, whatever else is asked in
    between. Each episode needs an instance of its own to be repeatable.

    Args:
        seed: Seed of all answers.
        kinds: Relative frequencies of the kinds.
        plan: Function that returns the next action in the state of a request, or None.
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
        """Return an answer to the request in the form that it asks for."""
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
        # A hash of the conversation, because requests of a resumed run come in another order.
        digest = hashlib.sha256()
        for message in request.messages:
            for part in (message.role, message.content):
                digest.update(part.encode(errors="replace") + b"\0")
        key = digest.digest()
        # Requests are counted, so that a repeated one does not get the same bad answer for ever.
        self._asked[key] += 1
        return f"{self._seed}:{digest.hexdigest()}:{self._asked[key]}"


def _robot(line: str) -> str:
    """Return the robot that a line of a joint answer is for."""
    return line.partition(": ")[0]


def _by_robot(lines: Iterable[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in lines:
        found.setdefault(_robot(line), []).append(line)
    return found


def _wish(line: str, form: AnswerForm) -> str:
    """Return an action as part of a sentence, without the robot's name before it."""
    action = line.partition(": ")[2] if form is AnswerForm.JOINT else line
    return f"{action[:1].lower()}{action[1:]}"


def written(
    kind: AnswerKind, chosen: Sequence[str], other: str, form: AnswerForm = AnswerForm.STEP
) -> Scripted:
    """Return an answer of a kind and form with one action, or one for each robot."""
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
