"""Categories and subcategories of failures."""

from __future__ import annotations

from enum import StrEnum

from robotouille_evaluation.metrics.rows import Category


class Subcategory(StrEnum):
    """Subject of the uncertainty, with the names of the paper's figure if it has one.

    The paper has no rule about one player at a station, and assigns every failure to a category.
    """

    PREDICATES = "Misunderstands Predicates"
    INVALID_ACTION = "Invalid Action"
    ONE_ITEM = "Violates 'One item at station' rule"
    ONE_IN_HAND = "Violates 'Hold one item' rule"
    BOTH_RULES = "Violates both rules"
    ONE_PLAYER = "Violates 'One player at station' rule"
    OTHER_RULE = "Violates another rule"
    BAD_START = "Bad Start"
    INGREDIENT = "Ingredient Uncertainty"
    ORDER = "Order Uncertainty"
    BOTH_UNCERTAINTIES = "Both Uncertainties"
    OUT_OF_STEPS = "Out of Steps"
    NOT_PLAYED = "Broken Off"


CATEGORIES = {
    Subcategory.PREDICATES: Category.STATE,
    Subcategory.INVALID_ACTION: Category.ACTION,
    Subcategory.ONE_ITEM: Category.TRANSITION,
    Subcategory.ONE_IN_HAND: Category.TRANSITION,
    Subcategory.BOTH_RULES: Category.TRANSITION,
    Subcategory.ONE_PLAYER: Category.TRANSITION,
    Subcategory.OTHER_RULE: Category.TRANSITION,
    Subcategory.BAD_START: Category.GOAL,
    Subcategory.INGREDIENT: Category.GOAL,
    Subcategory.ORDER: Category.GOAL,
    Subcategory.BOTH_UNCERTAINTIES: Category.GOAL,
    Subcategory.OUT_OF_STEPS: Category.OTHER,
    Subcategory.NOT_PLAYED: Category.OTHER,
}

TOGETHER = {
    Subcategory.BOTH_RULES: {Subcategory.ONE_ITEM, Subcategory.ONE_IN_HAND},
    Subcategory.BOTH_UNCERTAINTIES: {Subcategory.INGREDIENT, Subcategory.ORDER},
}
"""Subcategories that stand for evidence of two others."""
