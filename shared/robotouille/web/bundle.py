"""All modules of the page in one file, which needs one request instead of thirty.

The page's modules use a small part of the syntax: imports by name and declarations with `export`,
each at the start of a line, and no circular imports. Each module becomes a function that returns
its exports. Everything else in the modules stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from posixpath import dirname, join, normpath

_IMPORT = re.compile(r'(?m)^import (?:(\w+)|\{([^}]+)\}) from "(\.[^"]+)";$')
_EXPORT = re.compile(r"(?m)^export ((?:async )?(?:function\*?|class|const) (\w+))")
_DEFAULT = re.compile(r"(?m)^export default ")
_REST = re.compile(r"(?m)^(?:import|export)\b.*$")


class BundleError(ValueError):
    """A module uses syntax that the bundle does not support."""


def bundle(entry: str, read: Callable[[str], str]) -> str:
    """Return a module and all modules that it imports as one module.

    Its default export has the exports of `entry`.

    Its address must be in the folder of `entry`, because addresses relative to a module stay.

    Args:
        entry: Name of the module, such as `play/main.js`.
        read: Function that returns the text of a module.

    Raises:
        BundleError: A module uses other syntax, or modules import each other in a circle.
    """
    numbers: dict[str, int | None] = {}
    parts: list[str] = []

    def add(name: str) -> int:
        if name in numbers:
            number = numbers[name]
            if number is None:
                raise BundleError(f"{name} imports itself through other modules")
            return number
        numbers[name] = None

        def imported(found: re.Match[str]) -> str:
            default, names, address = found.groups()
            number = add(normpath(join(dirname(name), address)))
            wanted = f"default: {default}" if default else names.strip().replace(" as ", ": ")
            return f"const {{ {wanted} }} = m{number};"

        text = _IMPORT.sub(imported, read(name))
        exports = [found[2] for found in _EXPORT.finditer(text)]
        text = _EXPORT.sub(r"\1", text)
        if _DEFAULT.search(text):
            text = _DEFAULT.sub("const m = ", text)
            exports.append("default: m")
        if rest := _REST.search(text):
            raise BundleError(f"the bundle does not support {rest[0]!r} in {name}")
        number = numbers[name] = len(parts)
        end = f"return {{ {', '.join(exports)} }};\n"
        parts.append(f"const m{number} = (() => {{\n{text}{end}}})();\n")
        return number

    first = add(entry)
    return "".join([*parts, f"export default m{first};\n"])
