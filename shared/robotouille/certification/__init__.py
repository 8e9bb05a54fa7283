"""Certificates of plan lengths, certified data sets, and their verification."""

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
    from robotouille.certification.certifying import BUDGET, certify_dataset, check_dataset
    from robotouille.certification.step_limit import plan_beside
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.certification.certificate",
        "robotouille.certification.step_limit",
        "robotouille.certification.certifying",
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
