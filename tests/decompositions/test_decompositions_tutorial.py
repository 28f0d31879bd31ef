"""The tutorial says what is so: its commands run, in their order, and print what the page shows.

What comes from a flight (blocks marked `flown`) is compared but for its numbers, which follow every change of
the reference agents.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl
import pytest

from decompositions import Level, load_decomposition

REPOSITORY = Path(__file__).parents[2]
PAGE = (REPOSITORY / "docs" / "tutorial.md").read_text()
COMMAND = re.compile(r"^\$ (.*(?:\n> .*)*)\n?", re.MULTILINE)
LONGEST_S = 400.0  # of all commands together, on a machine that does much else
OFFLINE = (
    "pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --no-index --target site "
)


@dataclass(frozen=True, slots=True)
class Shown:
    """A command of the page, what the page shows of its output, and whether its numbers come from a
    flight.
    """

    command: str
    output: tuple[str, ...]
    flown: bool

    @property
    def of_campaign(self) -> bool:
        """Whether it flies a campaign or reads one: minutes of CPU, all together."""
        return re.search(r"campaigns/|out/(rescue|hasty)", self.command) is not None

    def lines(self, text: str) -> list[str]:
        """What is compared: no rules of tables, no runs of spaces, and no numbers where these come from a
        flight.
        """
        rows = (" ".join(line.replace("┃", "│").split()) for line in text.splitlines())
        lines = [row for row in rows if row.strip("┏┓┡┩└┘├┤━─┳╇┴┼ ")]
        return [re.sub(r"[+-]?\d+(\.\d+)?", "N", row) for row in lines] if self.flown else lines


def shown() -> Iterator[Shown]:
    """Every command of the page, in order."""
    for kind, block in re.findall(r"^```console(.*?)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE):
        parts = COMMAND.split(block)
        for command, output in zip(parts[1::2], parts[2::2], strict=True):
            yield Shown(command.replace("\n> ", "\n"), tuple(output.splitlines()), kind.strip() == "flown")


SHOWN = tuple(shown())
SINGLE = [shown for shown in SHOWN if not shown.of_campaign]
OF_CAMPAIGN = [shown for shown in SHOWN if shown.of_campaign]
Completed = subprocess.CompletedProcess[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like the checkout to the page's commands, and leaves it as it is."""
    folder = tmp_path_factory.mktemp("tutorial")
    (folder / "out").mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    for name in ("campaigns", "decompositions", "examples"):
        (folder / name).symlink_to(REPOSITORY / name)
    return folder


def run_in(folder: Path, commands: Sequence[Shown]) -> list[Completed]:
    """Each command of the page, run once, whether or not those before it did what they should."""
    environment = os.environ | {"PYTHONPATH": str(folder / "site")}
    return [
        subprocess.run(
            ["bash", "-c", shown.command.replace("pip install ", OFFLINE)],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        for shown in commands
    ]


@pytest.fixture(scope="module")
def ran(folder: Path) -> list[Completed]:
    """The commands that need no campaign."""
    return run_in(folder, SINGLE)


@pytest.fixture(scope="module")
def campaign_ran(folder: Path) -> list[Completed]:
    """The commands about the two campaigns. They need nothing that the others leave."""
    return run_in(folder, OF_CAMPAIGN)


def of_each(commands: Sequence[Shown]) -> pytest.MarkDecorator:
    """A test for each of the commands."""
    names = [f"{index}-{shown.command.split()[1]}" for index, shown in enumerate(commands)]
    return pytest.mark.parametrize("index", range(len(commands)), ids=names)


@pytest.mark.timeout(LONGEST_S)
@of_each(SINGLE)
def test_a_command_prints_what_the_page_shows(ran: list[Completed], index: int) -> None:
    """Line by line, with gaps only where the page has `...`; what is refused says so on stderr, with code
    2.
    """
    compare_with_page(SINGLE[index], ran[index])


@pytest.mark.slow
@pytest.mark.timeout(LONGEST_S)
@of_each(OF_CAMPAIGN)
def test_a_command_about_a_campaign_prints_what_the_page_shows(
    campaign_ran: list[Completed], index: int
) -> None:
    """Likewise. Of `run`, `score` and `compare`, tests/cli has a form of seconds."""
    compare_with_page(OF_CAMPAIGN[index], campaign_ran[index])


def compare_with_page(shown: Shown, done: Completed) -> None:
    refused = bool(shown.output) and shown.output[0].startswith("rebar: ")
    assert done.returncode == (2 if refused else 0), f"{shown.command}\n{done.stdout}{done.stderr}"
    printed = done.stderr if refused else done.stdout
    rest = shown.lines(printed)
    for count, piece in enumerate(re.split(r"^\.\.\.$", "\n".join(shown.output), flags=re.MULTILINE)):
        wanted = shown.lines(piece)
        starts = [at for at in range(len(rest) - len(wanted) + 1) if rest[at : at + len(wanted)] == wanted]
        assert starts, "\n".join(["the page shows", *wanted, "which is not in", printed])
        assert count or starts[0] == 0, "\n".join(
            ["before what the page shows first, there is", *rest[: starts[0]]]
        )
        rest = rest[starts[0] + len(wanted) :]
    gap = bool(shown.output) and shown.output[-1] == "..."
    assert gap or not rest or not shown.output, "\n".join(["after what the page shows last, there is", *rest])


@pytest.mark.slow
@pytest.mark.timeout(LONGEST_S)
@pytest.mark.usefixtures("campaign_ran")
def test_the_campaign_finds_what_the_page_says(folder: Path) -> None:
    """Four difficulty configurations; with searchers near, the naive agent fails the care for people and the
    other passes.

    Both score 60 in it, with a confidence of two thirds and of one.
    """
    scores = pl.read_parquet(folder / "out" / "rescue" / "scores.parquet")
    assert scores["configuration"].n_unique() == 4
    care = scores.filter(node="KA-3")
    rates = care.filter(pl.col("considered") == 3)
    assert set(rates["design_point"]) == {"p002", "p004"}
    passed = {agent: rows["confidence"].min() == 1.0 for (agent,), rows in rates.group_by("agent")}
    assert passed == {"reference-naive": False, "reference-bystander-aware": True}
    far = care.filter(pl.col("considered") < 3)
    assert far["confidence"].to_list() == [1.0] * 4
    assert care["score"].to_list() == pytest.approx([60.0] * 8)
    means = {agent: rows["confidence"].mean() for (agent,), rows in care.group_by("agent")}
    assert means == pytest.approx({"reference-naive": 2 / 3, "reference-bystander-aware": 1.0})


@pytest.mark.parametrize(
    "block", re.findall(r"^```(?:yaml|python|toml)\n# (\S+)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
)
def test_what_is_quoted_stands_in_the_file(block: tuple[str, str]) -> None:
    """Each piece of a file on the page is a piece of that file, to the letter."""
    path, text = block
    assert text in (REPOSITORY / path).read_text()


def test_the_counts_are_right() -> None:
    """Three principles, five key attributes, twelve VABs, fifteen observables."""
    decomposition = load_decomposition("find-the-missing")
    principles, attributes, vabs, observables = (len(decomposition.at_level(level)) for level in Level)
    numbers = (
        f"{principles} principles, {attributes} key attributes, {vabs} VABs and {observables} observables"
    )
    assert numbers in " ".join(PAGE.split())
    assert {
        parent for parent in decomposition.key_attributes if "V-05" in decomposition.nodes[parent].children
    } == {
        "KA-2",
        "KA-5",
    }
