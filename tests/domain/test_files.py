"""Files that are not JSON, too large, too deeply nested or unreadable are refused."""

import os
import tracemalloc
from pathlib import Path

import pytest

from robotouille import FileError, load_task
from robotouille.domain.json_files import MAX_NESTING, parse_json, read_json
from robotouille.files.reading import MAX_FILE_BYTES

GOOD = '{"width": 3, "height": 3, "goal": [], "players": [{"name": "robot", "x": 0, "y": 0}]}'

BROKEN = {
    "empty": (b"", "the file is empty"),
    "blank": (b" \n\t ", "the file is empty"),
    "no JSON": (b"width = 3", "is not JSON: Expecting value at line 1, column 1"),
    "cut off": (GOOD[:40].encode(), "is not JSON: .* at line 1, column"),
    "followed by more": (GOOD.encode() + b"}", "is not JSON: Extra data"),
    "NaN": (GOOD.replace("3", "NaN", 1).encode(), "NaN is not a JSON number"),
    "Infinity": (GOOD.replace("3", "-Infinity", 1).encode(), "-Infinity is not a JSON number"),
    "a name twice": (b'{"width": 3, "width": 4}', "the name 'width' occurs twice in one object"),
    "Latin-1": ('{"goal_description": "Crêpe"}'.encode("latin-1"), "is not UTF-8 text: byte 24"),
    "binary": (bytes(range(256)), "is a binary file; expected a JSON file"),
    "picture": (b"\x89PNG\r\n\x1a\n\0\0", "is a PNG picture; expected a JSON file"),
    "UTF-16": ("{}".encode("utf-16"), "is not UTF-8 text: byte 0"),
    "deep": (b"[" * 100_000, f"nested more than {MAX_NESTING} levels"),
    "deep objects": (b'{"a":' * 5000 + b"1" + b"}" * 5000, "nested more than"),
    "a huge number": (
        b'{"width": ' + b"9" * 5000 + b"}",
        "json: has an integer with more than 4,300 digits$",
    ),
    "a list": (b"[]", "valid dictionary or instance of ProblemFile, found \\[\\]"),
    "null": (b"null", "valid dictionary or instance of ProblemFile, found None"),
}


@pytest.mark.parametrize("content", BROKEN.values(), ids=BROKEN.keys())
def test_invalid_files_raise(content: tuple[bytes, str], tmp_path: Path) -> None:
    path = tmp_path / "problem.json"
    path.write_bytes(content[0])
    with pytest.raises(FileError, match=content[1]) as error:
        load_task(str(path))
    assert error.value.file == str(path)
    assert str(error.value).startswith(f"{path}: ")
    assert len(error.value.faults) == 1


def test_huge_file_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(100 * 1024 * 1024)
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: pytest.fail("it was read"))
    with pytest.raises(FileError, match=f"104,857,600 bytes; at most {MAX_FILE_BYTES:,}"):
        load_task(str(path))


def test_unreadable_files_raise(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"cannot be read: No such file"):
        read_json(tmp_path / "nothing.json")
    with pytest.raises(FileError, match=r"is a folder; expected a JSON file"):
        read_json(tmp_path)
    folder = tmp_path / "folder.json"
    folder.mkdir()
    with pytest.raises(FileError, match=r"folder.json"):
        read_json(folder)
    if os.geteuid():
        secret = tmp_path / "secret.json"
        secret.touch(mode=0)
        with pytest.raises(FileError, match="Permission denied"):
            read_json(secret)


def test_endless_file_is_not_read() -> None:
    with pytest.raises(FileError, match="not a regular file"):
        read_json(Path("/dev/zero"))


def test_name_that_no_file_can_have() -> None:
    with pytest.raises(FileError, match="cannot be read: embedded null"):
        read_json(Path("a\0b"))


def test_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "problem.json"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert read_json(path)["width"] == 3


@pytest.mark.slow
def test_many_values_are_refused_before_they_are_decoded() -> None:
    text = f"[{'[],' * 3_000_000}[]]"
    tracemalloc.start()
    try:
        with pytest.raises(FileError, match="up to 9,000,004 values; at most 4,000,000"):
            parse_json(text, "here")
        assert tracemalloc.get_traced_memory()[1] < len(text)
    finally:
        tracemalloc.stop()
    assert parse_json(f"[{'0,' * 3_000_000}0]", "here")


def test_brackets_in_strings_do_not_count_as_nesting() -> None:
    deep = '{"words": "' + "[" * 200 + '\\"' + "{" * 200 + '"}'
    assert parse_json(deep, "here")["words"].count("[") == 200
    at_most = "[" * MAX_NESTING + "]" * MAX_NESTING
    assert parse_json(at_most, "here")
    with pytest.raises(FileError, match="nested"):
        parse_json(f"[{at_most}]", "here")
