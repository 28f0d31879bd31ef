"""The tutorial's page: its commands, and what it shows of their output."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
PATH = REPOSITORY / "docs" / "tutorial.md"
PAGE = PATH.read_text()
CONSOLE = re.compile(r"^```console(.*?)\n(.*?)^```", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^\$ (.*(?:\n> .*)*)\n?", re.MULTILINE)
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")
DURATION = re.compile(r"in \d+ s\b")  # of the host
LONGEST_S = 400.0  # of all commands together, on a machine that does much else
OFFLINE = (
    "pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --no-index --target site "
)
Completed = subprocess.CompletedProcess[str]


@dataclass(frozen=True, slots=True)
class Shown:
    """A command of the page, what the page shows of its output, and whether that comes from a flight."""

    command: str
    output: tuple[str, ...]
    flown: bool

    @property
    def of_campaign(self) -> bool:
        """Whether it flies a campaign or reads one: minutes of CPU, all together."""
        return re.search(r"campaigns/|out/(rescue|hasty)", self.command) is not None

    @property
    def refused(self) -> bool:
        """Whether the bench refuses the command, and says so on stderr."""
        return bool(self.output) and self.output[0].startswith("rebar: ")

    def difference(self, done: Completed, *, numbers: bool = True) -> str:
        """Where what was printed differs from what the page shows; empty where it does not. Without `numbers`, they may
        differ.
        """
        lines = compared(done.stderr if self.refused else done.stdout, numbers=numbers)
        rest = [line for _, line in lines]
        for count, piece in enumerate(self._pieces()):
            wanted = [line for _, line in compared("\n".join(piece), numbers=numbers)]
            starts = [
                at for at in range(len(rest) - len(wanted) + 1) if rest[at : at + len(wanted)] == wanted
            ]
            if not starts:
                return "\n".join(["the page shows", *wanted, "which is not in", *rest])
            if starts[0] and not count:
                return "\n".join(["before what the page shows first, there is", *rest[: starts[0]]])
            rest = rest[starts[0] + len(wanted) :]
        if rest and self.output and self.output[-1] != "...":
            return "\n".join(["after what the page shows last, there is", *rest])
        return ""

    def renumbered(self, done: Completed) -> Iterator[str]:
        """What the page shows, with the numbers that were printed. Raises ValueError where more than numbers differs."""
        if fault := self.difference(done, numbers=False):
            raise ValueError(f"{self.command}: {fault}")
        rest = compared(done.stderr if self.refused else done.stdout, numbers=False)
        for count, piece in enumerate(self._pieces()):
            if count:
                yield "..."
            wanted = [line for _, line in compared("\n".join(piece), numbers=False)]
            start = next(
                at
                for at in range(len(rest) - len(wanted) + 1)
                if [line for _, line in rest[at : at + len(wanted)]] == wanted
            )
            printed = iter(rest[start : start + len(wanted)])
            for line in piece:
                yield renumbered(line, next(printed)[0]) if kept(line) else line
            rest = rest[start + len(wanted) :]

    def _pieces(self) -> list[list[str]]:
        """The lines between the gaps of the page."""
        pieces: list[list[str]] = [[]]
        for line in self.output:
            if line == "...":
                pieces.append([])
            else:
                pieces[-1].append(line)
        return pieces


def renumbered(line: str, printed: str) -> str:
    """A line with the numbers of another one that has as many; spans of the host's time stay."""
    numbers = iter(NUMBER.findall(DURATION.sub("", printed)))
    pieces = re.split(f"({DURATION.pattern})", line)
    return "".join(
        piece if DURATION.fullmatch(piece) else NUMBER.sub(lambda _: next(numbers), piece) for piece in pieces
    )


def kept(line: str) -> str:
    """What is compared of a line: no rules of tables, and no runs of spaces."""
    row = " ".join(line.replace("┃", "│").split())
    return row if row.strip("┏┓┡┩└┘├┤━─┳╇┴┼ ") else ""


def compared(text: str, *, numbers: bool) -> list[tuple[str, str]]:
    """Each line of a text that is compared, as it is and with what the host decides left out, or all numbers."""
    rows = [row for line in text.splitlines() if (row := kept(line))]
    return [(row, DURATION.sub("in N s", row) if numbers else NUMBER.sub("N", row)) for row in rows]


def shown(page: str = PAGE) -> Iterator[Shown]:
    """Every command of the page, in order."""
    for kind, block in CONSOLE.findall(page):
        parts = COMMAND.split(block)
        for command, output in zip(parts[1::2], parts[2::2], strict=True):
            yield Shown(command.replace("\n> ", "\n"), tuple(output.splitlines()), kind.strip() == "flown")


SHOWN = tuple(shown())


def fill_folder(folder: Path) -> None:
    """Let a folder look like the checkout to the page's commands."""
    (folder / "out").mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    for name in ("campaigns", "decompositions", "examples"):
        (folder / name).symlink_to(REPOSITORY / name)


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


def renumbered_page(folder: Path) -> str:
    """The page with the numbers that its commands give now, run in an empty folder."""
    fill_folder(folder)
    done = iter(zip(SHOWN, run_in(folder, SHOWN), strict=True))

    def block(match: re.Match[str]) -> str:
        lines = []
        for command in COMMAND.findall(match[2]):
            shown, completed = next(done)
            lines += [f"$ {command}", *(shown.renumbered(completed) if shown.flown else shown.output)]
        return "\n".join([f"```console{match[1]}", *lines, "```"])

    return CONSOLE.sub(block, PAGE)
