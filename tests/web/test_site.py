"""Files that the server gives to browsers."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import pytest

import robotouille_server
from robotouille.domain.task import read_domain
from robotouille.installation import data_folder
from robotouille.web import WebSite
from robotouille.web.site import BUNDLE, STATIC, without_comments

OPERATOR = Path(robotouille_server.__file__).parent / "operator/page"
MOST_LINES = {"rules": 2415, "kitchen": 1703, "play": 2384, "replay": 1459, "texts": 352}
"""Bounds of the page's parts. Lower them when a part shrinks (docs/decisions/0050)."""
MOST_LINES_OF_OPERATOR = 1646


@pytest.fixture(scope="module")
def site() -> WebSite:
    return WebSite()


def served_modules() -> list[Path]:
    """Return the modules of the page. Those of the replay page are in files that it writes."""
    return [path for path in STATIC.rglob("*.js") if path.parent.name != "replay"]


def test_every_module_that_a_module_imports_is_served(site: WebSite) -> None:
    for path in served_modules():
        for line in path.read_text().splitlines():
            if line.startswith(("import ", "} from ")) and ' from "' in f" {line}":
                name = line.rpartition(' "')[2].strip('";')
                wanted = (path.parent / name).resolve().relative_to(STATIC.resolve())
                assert site.find(wanted.as_posix()) is not None, f"{path.name}: {name}"


def test_every_shipped_domain_has_a_look_with_all_its_pictures(site: WebSite) -> None:
    domains = [p.stem for p in data_folder("domains").glob("*.json") if "." not in p.stem]
    domains.remove("published_defaults")
    assert len(domains) > 3
    for domain in domains:
        look = site.find(f"looks/{domain}.json")
        assert look is not None
        found = json.loads(look.content)
        actions = {a.name for a in read_domain(domain).action_defs}
        bound = {
            each["name"]
            for kind in ("mouse_click_actions", "keyboard_actions")
            for each in found["bindings"].get(kind, ())
        }
        assert bound == actions
        rendering = found["rendering"]
        folders = [rendering.get("assets", "kitchen"), *rendering.get("inherited_assets", ())]
        pictures: set[str] = set()
        for folder in folders:
            file = site.find(f"pictures/{folder}.json")
            assert file is not None
            pictures |= json.loads(gzip.decompress(file.packed)).keys()
        named = {w for w in json.dumps(rendering).split('"') if w.endswith((".svg", ".png"))}
        assert named <= pictures


def test_a_change_of_any_file_changes_the_address_of_all(tmp_path: Path) -> None:
    for name, content in {"index.html": "<p>{files}", "a.js": "let a;", "b.css": "p {}"}.items():
        (tmp_path / name).write_text(content)
    before = WebSite(tmp_path)
    assert before.version == WebSite(tmp_path).version
    assert before.version.encode() in before.page().content
    (tmp_path / "b.css").write_text("p { }")
    assert WebSite(tmp_path).version != before.version


def test_comments_are_not_sent(site: WebSite) -> None:
    source = (
        b"// one\n/** two\n * three */\nlet a = /** @type {any} */ (1); // four\n  // five\nb();\n"
    )
    assert without_comments(source) == b"let a = /** @type {any} */ (1); // four\nb();\n"
    for path in served_modules():
        file = site.find(path.relative_to(STATIC).as_posix())
        assert file is not None
        assert b"\n/**" not in file.content


def test_page_fits_into_120_kib(site: WebSite) -> None:
    text = site.page().content.decode()
    names = {part.partition('"')[0] for part in text.split(f"play/{site.version}/")[1:]}
    assert BUNDLE in names
    files = [site.find(name) for name in names]
    # Answers have heads of about 400 bytes.
    size = sum(len(file.packed) + 400 for file in files if file is not None)
    assert size < 120 * 1024


def lines_of_code(path: Path) -> int:
    """Return the lines of a script or style sheet without blank lines and comments."""
    text = re.sub(r"(?s)/\*.*?\*/", "", path.read_text(encoding="utf-8"))
    lines = map(str.strip, text.splitlines())
    return sum(1 for line in lines if line and not line.startswith("//"))


def test_page_grows_no_further() -> None:
    found = dict.fromkeys(MOST_LINES, 0)
    for path in (*STATIC.rglob("*.js"), *STATIC.rglob("*.css")):
        part = path.relative_to(STATIC).parts[0]
        found["play" if part == "page.css" else part] += lines_of_code(path)
    assert {part: lines for part, lines in found.items() if lines > MOST_LINES[part]} == {}
    page = (*OPERATOR.glob("*.js"), *OPERATOR.glob("*.css"))
    assert sum(map(lines_of_code, page)) <= MOST_LINES_OF_OPERATOR
