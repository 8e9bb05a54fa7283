"""Rendering files: which picture shows which object, and what people call it."""

from __future__ import annotations

from robotouille.domain.rendering.art import Art, Facings, ParticleEffect, Trait
from robotouille.domain.rendering.rendering_file import (
    NO_WORDS,
    RENDERING_FILES,
    ActionWords,
    Constants,
    Entity,
    KindName,
    Language,
    PlaceWords,
    PredicateWords,
    RenderingFile,
    WorkWords,
    language_of,
    read_language,
    rendering_of,
)

__all__ = [
    "NO_WORDS",
    "RENDERING_FILES",
    "ActionWords",
    "Art",
    "Constants",
    "Entity",
    "Facings",
    "KindName",
    "Language",
    "ParticleEffect",
    "PlaceWords",
    "PredicateWords",
    "RenderingFile",
    "Trait",
    "WorkWords",
    "language_of",
    "read_language",
    "rendering_of",
]
