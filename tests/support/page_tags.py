"""The tags of a page, and that it asks for nothing and runs nothing."""

from __future__ import annotations

from html.parser import HTMLParser

__all__ = ["Tags", "check_harmless"]


class Tags(HTMLParser):
    """Every tag of a page with its attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def check_harmless(page: str) -> None:
    """It has no script, no style but its own, and nothing that is loaded from anywhere."""
    for tag, attributes in Tags(page).found:
        assert tag not in ("script", "link", "iframe", "img", "object", "form", "base")
        assert not any(name.startswith("on") or name == "style" for name in attributes), attributes
        for name in ("src", "xlink:href"):
            assert (attributes.get(name) or "#").startswith("#")
        assert "//" not in (attributes.get("href") or "")
    assert "url(http" not in page
    assert "@import" not in page
