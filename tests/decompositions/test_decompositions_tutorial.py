"""The tutorial says what is so: its commands run, in their order, and print what the page shows.

What comes from a flight (blocks marked `flown`) is written by tests/agent_adapters/shipped_agents.py.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import polars as pl
import pytest
from tutorial_page import LONGEST_S, PAGE, REPOSITORY, SHOWN, Completed, Shown, fill_folder, run_in

from decompositions import Level, load_decomposition

SINGLE = [shown for shown in SHOWN if not shown.of_campaign]
OF_CAMPAIGN = [shown for shown in SHOWN if shown.of_campaign]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like the checkout to the page's commands, and leaves it as it is."""
    folder = tmp_path_factory.mktemp("tutorial")
    fill_folder(folder)
    return folder


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
    assert done.returncode == (2 if shown.refused else 0), f"{shown.command}\n{done.stdout}{done.stderr}"
    assert shown.difference(done) == "", "run tests/agent_adapters/shipped_agents.py, and read the page again"


def test_the_page_takes_over_numbers_alone() -> None:
    """Numbers of the host's time stay; a line that says something else is refused."""
    shown = Shown(
        "fly", ("8 sessions (in 17 s): 8 completed", "...", "KA-3   66.7 % (14–98)", "..."), flown=True
    )
    text = "8 sessions (in 3 s): 7 completed\nother\n━━━\nKA-3 75 % (19–99)\nend\n"
    assert shown.difference(subprocess.CompletedProcess("", 0, text, "")) != ""
    assert list(shown.renumbered(subprocess.CompletedProcess("", 0, text, ""))) == [
        *("8 sessions (in 17 s): 7 completed", "...", "KA-3   75 % (19–99)", "...")
    ]
    with pytest.raises(ValueError, match="fly: the page shows"):
        list(shown.renumbered(subprocess.CompletedProcess("", 0, text.replace("KA-3", "KA-B"), "")))


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
