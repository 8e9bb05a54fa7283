"""The page's modules in one file."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from robotouille.web import shared_site
from robotouille.web.bundle import BundleError, bundle
from tests.support.node import node

MODULES = {
    "play/main.js": 'import { half as part } from "../rules/a.js";\n'
    'import { TWO } from "../rules/b.js";\n'
    'import words from "./words.js";\n'
    "console.log(JSON.stringify([part(8), TWO, words.hello, import.meta.url.slice(-8)]));\n",
    "play/words.js": 'export default {\n  hello: "export me",\n};\n',
    "rules/a.js": 'import { TWO } from "./b.js";\n'
    "const own = (n) => n / TWO;\nexport function half(n) {\n  return own(n);\n}\n",
    "rules/b.js": "export const TWO = 2;\nexport class Own {}\nexport async function* none() {}\n",
}


@pytest.mark.process
def test_bundle_does_what_its_modules_do(tmp_path: Path) -> None:
    file = tmp_path / "all.mjs"
    file.write_text(bundle("play/main.js", MODULES.__getitem__))
    done = subprocess.run([node(), str(file)], capture_output=True, text=True)
    assert done.stderr == ""
    assert json.loads(done.stdout) == [4, 2, "export me", "/all.mjs"]


@pytest.mark.parametrize(
    "text",
    [
        "export { TWO };\n",
        'import * as all from "./b.js";\n',
        "export let a = 1;\n",
        'import "./b.js";',
    ],
)
def test_other_syntax_is_an_error(text: str) -> None:
    with pytest.raises(BundleError, match="does not support"):
        bundle("a.js", {"a.js": text, "b.js": ""}.__getitem__)


def test_modules_that_import_each_other_are_an_error() -> None:
    modules = {"a.js": 'import { b } from "./b.js";', "b.js": 'import { a } from "./a.js";'}
    with pytest.raises(BundleError, match="imports itself"):
        bundle("a.js", modules.__getitem__)


@pytest.mark.process
def test_page_is_one_script(tmp_path: Path) -> None:
    found = shared_site().find("play/bundle.js")
    assert found is not None
    file = tmp_path / "bundle.mjs"
    file.write_bytes(found.content)
    done = subprocess.run([node(), "--check", str(file)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(found.packed) < 71_000
