"""HTML pages for the reports of the load test, the catalogue and the benchmark.

Each page is one file without scripts, so it can be opened from a disk or sent by mail. The core
does not import this package: its libraries come with the extras `load`, `data` and `bench`.
"""

from __future__ import annotations

from importlib.util import find_spec

from robotouille.errors import MissingExtraError


def require_libraries(feature: str, extra: str) -> None:
    """Check that the libraries for pages and figures are installed.

    Raises:
        MissingExtraError: A library is missing. The message names the feature and the extra.
    """
    if not all(map(find_spec, ("jinja2", "matplotlib", "numpy"))):
        raise MissingExtraError(feature, extra)
