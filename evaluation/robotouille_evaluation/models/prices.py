"""What tokens cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotouille.errors import WrongArgumentError

__all__ = ["Prices"]

MILLION = 1_000_000


@dataclass(frozen=True, slots=True)
class Prices:
    """Prices of a million tokens sent and received, in any currency.

    Discounts (of cached prompts, of batches) are not known here: costs are an upper bound.
    """

    prompt: float
    completion: float

    @classmethod
    def parse(cls, text: str) -> Prices:
        """Prices as a flag gives them: `2.50/10`.

        Raises:
            WrongArgumentError: That is no pair of prices.
        """
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

    def cost(self, prompt_tokens: int, completion_tokens: int) -> float:
        """What these tokens cost."""
        return (prompt_tokens * self.prompt + completion_tokens * self.completion) / MILLION
