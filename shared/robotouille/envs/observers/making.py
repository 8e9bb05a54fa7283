"""The observer for an environment's options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from robotouille.envs.layout import Layout
from robotouille.envs.observers.graph_observer import GraphObserver
from robotouille.envs.observers.observer import Observer
from robotouille.envs.observers.text_observer import TextObserver
from robotouille.envs.observers.vector_observer import VectorObserver
from robotouille.envs.rules import EnvObservation, EnvRules, Perspective
from robotouille.envs.views import ObservationView

OBSERVERS: Mapping[EnvObservation, type[Observer]] = {
    EnvObservation.VECTOR: VectorObserver,
    EnvObservation.GRAPH: GraphObserver,
    EnvObservation.TEXT: TextObserver,
}


def observer_of(
    rules: EnvRules, views: Sequence[ObservationView], perspective: Perspective
) -> Observer:
    """Return the observer of the kind that the rules ask for."""
    kind = EnvObservation(rules.observation)
    return OBSERVERS[kind](Layout(rules, views, perspective))
