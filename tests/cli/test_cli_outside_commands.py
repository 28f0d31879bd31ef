"""Commands that packages add, with entry points that no installed package has."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from command_line import Rebar

from bench.cli._app import run
from bench.contracts import plugins
from bench.documents import Document


def greet(name: str, loud: bool = False) -> None:
    """Greet somebody.

    Example: rebar greet Ada
    """
    print(f"Hello {name}{'!' if loud else ''}")


def count(until: int) -> None:
    """Count to a number."""
    print(*range(1, until + 1))


class Greeting(Document):
    """Who is greeted."""

    name: str


def declare(monkeypatch: pytest.MonkeyPatch, name: str, place: str) -> None:
    monkeypatch.setitem(plugins("rebar.commands"), name, EntryPoint(name, place, "rebar.commands"))


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> None:
    declare(monkeypatch, "greet", f"{__name__}:greet")
    declare(monkeypatch, "tally", f"{__name__}:count")


@pytest.mark.usefixtures("two")
@pytest.mark.parametrize(
    ("line", "shown"),
    [
        (["greet", "Ada"], "Hello Ada\n"),
        (["greet", "Ada", "--loud"], "Hello Ada!\n"),
        # Called as the entry point is, whatever the function's name.
        (["tally", "3"], "1 2 3\n"),
    ],
)
def test_commands_are_called_by_their_entry_points(line: list[str], shown: str, rebar: Rebar) -> None:
    assert rebar(*line) == shown


@pytest.mark.usefixtures("two")
def test_help_lists_them_after_the_own_ones(rebar: Rebar) -> None:
    lines = [line.split(maxsplit=1) for line in rebar("--help").splitlines()]
    assert lines[-2:] == [["greet", "Greet somebody."], ["tally", "Count to a number."]]
    assert "simulate" in [line[0] for line in lines if line]
    shown = rebar("greet", "--help")
    assert "rebar greet Ada" in shown
    assert "--loud" in shown
    assert "--install-completion" not in shown


@pytest.mark.usefixtures("two")
@pytest.mark.parametrize("line", [["count", "3"], ["tally", "many"], ["greet"], ["greet", "Ada", "--loudly"]])
def test_wrong_usage_of_them_is_answered_as_that_of_the_own_ones(line: list[str], rebar: Rebar) -> None:
    assert rebar(*line, code=2) == ""


@pytest.mark.parametrize("line", [["--help"], ["greet", "Ada"]])
@pytest.mark.parametrize("name", ["simulate", "next", "camera"])
def test_a_name_of_the_bench_is_refused(
    name: str, line: list[str], monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    declare(monkeypatch, name, f"{__name__}:greet")
    fault = f"rebar.commands: {name!r} of an unknown package is a command of the bench"
    assert fault in rebar.refused(*line)
    assert "Greet somebody" not in rebar(name, "--help")


def test_a_package_that_cannot_be_imported_is_named(monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> None:
    declare(monkeypatch, "broken", "no_such_module:command")
    assert "'broken' of an unknown package cannot be imported" in rebar.refused("broken")
    # Whoever does not ask for it does not meet it.
    assert run(["schema"]) == 0


def test_an_example_says_how_it_is_installed(monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> None:
    monkeypatch.delitem(plugins("rebar.commands"), "fit-detector", raising=False)
    assert "pip install examples/detector_fit" in rebar.refused("fit-detector", "recording.mcap")
    assert "No such command 'fit-nothing'" in rebar.refused("fit-nothing")


def test_documents_of_packages_have_schemas(monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> None:
    """One by the name of the bench's own leaves that as it is."""
    own = rebar("schema", "simspec")
    for name in ("greeting", "simspec"):
        entry = EntryPoint(name, f"{__name__}:Greeting", "rebar.documents")
        monkeypatch.setitem(plugins("rebar.documents"), name, entry)
    assert "Who is greeted." in rebar("schema", "greeting")
    assert rebar("schema", "simspec") == own
    assert " greeting," in rebar.refused("schema", "greetings")


def test_a_command_of_the_bench_searches_for_no_others(tmp_path: Path) -> None:
    """What is installed is looked at for help and for names that the bench does not have, and only then imported."""
    look = "from bench.plugins import plugins; print('looked', plugins.cache_info().currsize)"
    script = f"from bench.cli._app import run; run(['score', '--help']); {look}; run(['--help']); {look}"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path)
    assert re.findall(r"^looked \d$", done.stdout, re.MULTILINE) == ["looked 0", "looked 1"]
