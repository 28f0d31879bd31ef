"""Files and programs are read and written as UTF-8, whatever the locale is: each call names its encoding."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("bench", "vehicle_models", "test_ports", "agent_adapters", "decompositions")
TEXT_MODE = re.compile("[rwax]t?[+]?")


def calls_without_encoding(source: str) -> Iterator[int]:
    """Lines of calls that open a file or a program as text in the encoding of the locale."""
    for node in ast.walk(ast.parse(source)):
        given = {word.arg: word.value for word in node.keywords} if isinstance(node, ast.Call) else {}
        if not isinstance(node, ast.Call) or "encoding" in given:
            continue
        is_method = isinstance(node.func, ast.Attribute)
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        match name:
            case "read_text" if not node.args:
                yield node.lineno
            case "write_text" if len(node.args) == 1:
                yield node.lineno
            case "open" | "fdopen" | "NamedTemporaryFile" | "TemporaryFile":
                # Temporary files are binary without a mode, and what is no file is opened with something else.
                is_temporary = name.endswith("File")
                place = 0 if is_temporary or (is_method and name == "open") else 1
                modes = [given["mode"]] if "mode" in given else node.args[place : place + 1]
                constant = [str(mode.value) for mode in modes if isinstance(mode, ast.Constant)]
                if any(map(TEXT_MODE.fullmatch, constant)) or not (modes or is_temporary):
                    yield node.lineno
            case "run" | "Popen" | "check_output" if "text" in given or "universal_newlines" in given:
                yield node.lineno


@pytest.mark.parametrize("package", PACKAGES)
def test_no_file_depends_on_the_locale(package: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in sorted((ROOT / package).rglob("*.py"))
        for line in calls_without_encoding(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("open('a')", 1),
        ("open('a', 'w')", 1),
        ("open('a', mode='r+')", 1),
        ("open('a', 'rb')", 0),
        ("open('a', encoding='utf-8')", 0),
        ("path.open()", 1),
        ("path.open('a')", 1),
        ("path.open('ab')", 0),
        ("kind.open(plan)", 0),
        ("path.read_text()", 1),
        ("path.read_text('utf-8')", 0),
        ("path.write_text(text)", 1),
        ("path.write_text(text, encoding='utf-8')", 0),
        ("os.fdopen(3)", 1),
        ("os.fdopen(3, 'wb')", 0),
        ("NamedTemporaryFile()", 0),
        ("NamedTemporaryFile('w')", 1),
        ("subprocess.run(line, text=True)", 1),
        ("subprocess.run(line)", 0),
    ],
)
def test_calls_are_told_apart(source: str, count: int) -> None:
    assert len(list(calls_without_encoding(source))) == count
