"""The tags of an HTML page, and a check that the page loads and runs nothing."""

from __future__ import annotations

from html.parser import HTMLParser

__all__ = ["Tags", "check_harmless"]


class Tags(HTMLParser):
    """All tags of a page with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def check_harmless(page: str) -> None:
    """Check that a page has no script, no inline style and no external resource."""
    for tag, attributes in Tags(page).found:
        assert tag not in ("script", "link", "iframe", "img", "object", "form", "base")
        assert not any(name.startswith("on") or name == "style" for name in attributes), attributes
        for name in ("src", "xlink:href"):
            assert (attributes.get(name) or "#").startswith("#")
        assert "//" not in (attributes.get("href") or "")
    assert "url(http" not in page
    assert "@import" not in page
