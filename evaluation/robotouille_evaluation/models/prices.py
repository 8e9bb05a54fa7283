"""Prices of tokens: those of an option, or list prices of the package `genai_prices`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from robotouille.errors import WrongArgumentError

PRICE_BASE = 1_000_000
CostOf = Callable[[int, int, int], float | None]
"""Cost of prompt tokens, completion tokens, and the cached ones among the prompt tokens."""


@dataclass(frozen=True, slots=True)
class Prices:
    """Prices of a million tokens sent and received, in US dollars.

    They have no discount for cached prompts, so a cost is an upper bound.
    """

    prompt: float
    completion: float

    @classmethod
    def parse(cls, text: str) -> Prices:
        """Return the prices of an option such as `2.50/10`, or raise `WrongArgumentError`."""
        try:
            prompt, completion = (float(part) for part in text.split("/"))
        except ValueError:
            prompt = completion = math.nan
        if not (0 <= prompt < math.inf and 0 <= completion < math.inf):
            raise WrongArgumentError(
                f"expected prices of a million tokens sent and received, "
                f"such as 2.50/10, found {text!r}"
            )
        return cls(prompt, completion)

    def cost(self, prompt_tokens: int, completion_tokens: int, cached: int = 0) -> float:
        """Return the cost of these tokens."""
        return (prompt_tokens * self.prompt + completion_tokens * self.completion) / PRICE_BASE


def listed_cost(
    model: str, base_url: str, prompt_tokens: int, completion_tokens: int, cached: int
) -> float | None:
    """Return the list price in US dollars, or None for an unlisted endpoint or model."""
    import genai_prices

    usage = genai_prices.Usage(
        input_tokens=prompt_tokens, output_tokens=completion_tokens, cache_read_tokens=cached
    )
    try:
        price = genai_prices.calc_price(usage, model, provider_api_url=base_url)
    except LookupError:
        return None
    return float(price.total_price)
