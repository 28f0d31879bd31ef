"""docs/rulings.md: numbered 1 to 25, each ruling with its reason, and every citation in the tree resolves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
RULINGS = ROOT / "docs" / "rulings.md"
SEARCHED = (
    "bench",
    "vehicle_models",
    "test_ports",
    "agent_adapters",
    "decompositions",
    "tests",
    "benchmarks",
    "examples",
    "docs",
)
SUFFIXES = (".py", ".md", ".yaml", ".toml", ".j2")
CITATION = re.compile(r"\b(?:rulings\.md|[Rr]ulings?)\s+(?=\d)((?:\d+(?:\s*,\s*|\s+(?:and|to)\s+)?)+)")

NOT_IMPLEMENTED = {28}


def rulings() -> dict[int, str]:
    """The text of every ruling by its number, on one line: a phrase may be broken over two lines of the page."""
    parts = re.split(r"^(\d+)\. ", RULINGS.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {int(number): " ".join(text.split()) for number, text in zip(parts[::2], parts[1::2], strict=True)}


def texts() -> Iterator[tuple[Path, str]]:
    paths = [ROOT / "README.md", ROOT / "CHANGELOG.md"]
    paths += [
        path for folder in SEARCHED for path in sorted((ROOT / folder).rglob("*")) if path.suffix in SUFFIXES
    ]
    for path in paths:
        if path != Path(__file__):
            yield path.relative_to(ROOT), path.read_text(encoding="utf-8")


def cited(text: str) -> set[int]:
    """Numbers of the rulings that a text cites."""
    return {int(number) for match in CITATION.finditer(text) for number in re.findall(r"\d+", match[1])}


def test_rulings_are_numbered_from_1_to_32_with_reasons() -> None:
    """No number is missing, none is used twice, and each ruling gives its reason."""
    assert sorted(rulings()) == list(range(1, 33))
    assert [number for number, text in rulings().items() if "*Reason:*" not in text] == []


def test_rulings_without_an_implementation_say_what_holds_today() -> None:
    """A reader is told that they are decided only, and what the code does instead."""
    marked = {number for number, text in rulings().items() if "not implemented yet" in text}
    assert marked == NOT_IMPLEMENTED
    assert all("*Today:*" in rulings()[number] for number in marked)


def test_every_citation_resolves() -> None:
    """Whoever follows a citation finds the ruling; the page that is not in the repository is cited nowhere."""
    numbers = set(rulings())
    assert {str(path): sorted(cited(text) - numbers) for path, text in texts() if cited(text) - numbers} == {}
    assert [str(path) for path, text in texts() if "reading.md" in text] == []


def test_the_tree_cites_rulings() -> None:
    """The search finds the citations that scoring has."""
    citing = {str(path) for path, text in texts() if cited(text)}
    assert {
        "bench/scoring/_scores.py",
        "bench/statistics/_competence.py",
        "bench/contracts/_outcome.py",
    } <= citing
