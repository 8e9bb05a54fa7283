"""Pages, figures and intervals that all reports share."""

from __future__ import annotations

import base64
import hashlib
import random
import re
import statistics
from collections.abc import Iterator
from functools import cache
from xml.etree import ElementTree

import pytest

pytest.importorskip("jinja2", reason="needs the extra `data`, `bench` or `load`")
pytest.importorskip("matplotlib", reason="needs the extra `data`, `bench` or `load`")

import numpy as np

from robotouille.html_report.figures import (
    FAINT,
    INK,
    SOFT,
    ReportFigure,
    distinct_labels,
    draw_figure,
    inline_svg,
)
from robotouille.html_report.intervals import Interval, median_interval, wilson_interval
from robotouille.html_report.page import (
    FOLDER,
    Cell,
    Details,
    FigureGrid,
    Heading,
    Page,
    Remarks,
    Section,
    Table,
    TableRow,
    render_page,
)
from tests.support.page_tags import Tags, check_harmless

HOSTILE = "<script>alert(1)</script>\"'&$x^2$ \x07\u202e 日本語 </style></svg>]]>-->{0}%s{{ x }}"


@cache
def figure(name: str) -> ReportFigure:
    return draw_figure(name, name, (3, 2), lambda canvas: canvas.add_subplot().plot([1, 2]))


def page_of(text: str) -> str:
    row = TableRow((text, Cell(text, css="won"), Cell(text, code=True), text), reference=True)
    table = Table((text, "a", "b", "c"), [row], text, text, f"`{text}`", frozenset({text}))
    blocks = [
        table, figure(text), FigureGrid([figure("one"), figure("two")]), Heading(text, text),
        Details(text, text, [Remarks([text])], open=True),
    ]  # fmt: skip
    return render_page(
        Page(text, text, [(text, text)], [text], [Section("s", text, text, blocks)], text)
    )


def test_page_has_no_scripts_and_only_its_own_style() -> None:
    page = page_of("plain")
    check_harmless(page)
    tags = Tags(page).found
    (policy,) = (
        attributes["content"]
        for tag, attributes in tags
        if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy"
    )
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert policy == (
        f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )
    ids = [attributes["id"] for _, attributes in tags if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_text_is_escaped_everywhere() -> None:
    page = page_of(HOSTILE)
    assert {tag for tag, _ in Tags(page).found} == {tag for tag, _ in Tags(page_of("plain")).found}
    assert not {"\x07", "\u202e"} & set(page)
    assert page.count("</style>") == 1


@pytest.mark.slow
def test_equal_pages_give_equal_text() -> None:
    one = page_of("plain")
    figure.cache_clear()
    assert page_of("plain") == one


def test_style_replaces_the_colours_of_figures_in_dark_mode() -> None:
    style = (FOLDER / "page.css").read_text(encoding="utf-8")
    assert all(f'[stroke="{colour}"]' in style for colour in (INK, SOFT, FAINT))


def test_embedded_svg_is_valid_without_style_attributes() -> None:
    svg = inline_svg(figure(HOSTILE))
    ElementTree.fromstring(svg)
    assert "style=" not in svg


def test_labels_omit_shared_parts_and_stay_distinct() -> None:
    model = "openai/some-organisation/quite-a-long-name-70b-instruct"
    names = [f"react-last-observation · {model} · {pack} · own" for pack in ("ours 1", "theirs 2")]
    labels = distinct_labels([*names, "planner · ours 1 · own"])
    for name, pack in zip(names, ("ours 1", "theirs 2"), strict=True):
        whole = f"react-last-observation · {model} · {pack}"
        assert labels[name].replace("\n", "").replace(" ", "") == whole.replace(" ", "")
    assert labels["planner · ours 1 · own"] == "planner · ours 1"
    long = [f"{letter * 999} the end" for letter in "xy"]
    assert all(label.endswith("the end") for label in distinct_labels(long).values())
    hidden = distinct_labels([f"{'x' * 400}{n}{'x' * 400}" for n in range(3)])
    assert len({*hidden.values()}) == 3
    assert distinct_labels(["planner"]) == {"planner": "planner"}
    own = distinct_labels(["planner · free · own", "planner · free · published"])
    assert list(own.values()) == ["planner · own", "planner · published"], "never without the agent"


# Intervals


def test_interval_in_words() -> None:
    assert Interval(0.5, 0.25, 0.75, 4).text("{:.1f}".format, "{:.2f}".format) == "0.5 (0.25–0.75)"
    assert Interval(0.5, None, None, 1).text(str) == "0.5"


def test_wilson_interval() -> None:
    """Compare with Newcombe's tables (Statistics in Medicine 17, 1998)."""
    for successes, count, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = wilson_interval(successes, count)
        assert found is not None
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(0, 0) is None


def slow_medians(values: list[float], clusters: list[str], seed: int) -> Iterator[float]:
    """Yield the bootstrap medians, computed cluster by cluster."""
    own = {name: [v for v, c in zip(values, clusters, strict=True) if c == name]
           for name in clusters}  # fmt: skip
    names = list(own)
    for row in np.random.default_rng(seed).integers(len(names), size=(1000, len(names))):
        yield statistics.median([value for place in row for value in own[names[place]]])


@pytest.mark.parametrize("seed", range(5))
def test_median_interval_equals_a_plain_bootstrap(seed: int) -> None:
    rng = random.Random(seed)
    clusters = [f"p{rng.randrange(6)}" for _ in range(25)]
    values = [float(rng.randrange(10)) for _ in clusters]
    found = median_interval(values, clusters, seed)
    assert found is not None
    assert found.estimate == statistics.median(values)
    low, high = np.quantile(list(slow_medians(values, clusters, seed)), (0.025, 0.975))
    assert (found.low, found.high) == pytest.approx((low, high))


def test_median_of_two_clusters_has_no_bounds() -> None:
    assert median_interval([1.0, 2.0, 3.0], ["a", "a", "b"]) == Interval(2.0, None, None, 3)
    assert median_interval([], []) is None
