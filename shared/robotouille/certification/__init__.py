"""What is proven of plans, written down: certificates, datasets of them, and their check."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.certification.certificate import (
        Certificate,
        Deadline,
        ExpansionBudget,
        Solver,
        certify,
        check,
        load_certificate,
        write_certificate,
    )
    from robotouille.certification.certifying import BUDGET, certify_dataset
    from robotouille.certification.checking import check_dataset
    from robotouille.certification.shipped_plan import plan_beside
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.certification.certificate",
        "robotouille.certification.shipped_plan",
        "robotouille.certification.certifying",
        "robotouille.certification.checking",
    )

__all__ = [
    "BUDGET",
    "Certificate",
    "Deadline",
    "ExpansionBudget",
    "Solver",
    "certify",
    "certify_dataset",
    "check",
    "check_dataset",
    "load_certificate",
    "plan_beside",
    "write_certificate",
]
