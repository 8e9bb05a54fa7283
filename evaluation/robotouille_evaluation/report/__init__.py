"""Reports on benchmark runs: tables, figures and one HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_evaluation.report.write import write_report
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(__name__, "robotouille_evaluation.report.write")

__all__ = ["write_report"]
