"""Tables that come from elsewhere: one row for each run and observable, as CSV (docs/rulings.md 19).

Nothing is guessed and nothing is repaired: every violation is a fault with its line, and all faults are
reported at once.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from bench.contracts import Observation, Outcome
from bench.documents import decimal_number
from bench.errors import MAX_FAULTS, Fault, SetupError
from decompositions import Decomposition

from ._difficulty import Difficulty, difficulty_of_values, stated_difficulty
from ._table import ScoredRun

REQUIRED_COLUMNS = ("run", "observable", "x")
KNOWN_COLUMNS = ("run", "observable", "difficulty", "x", "considered", "design_point", "agent")
# The agent of a table without a column `agent`.
DEFAULT_AGENT = "agent"
# Ruling 19: an empty cell means considered, because most tables hold nothing else.
_CONSIDERED_WORDS = {"": True, "true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


@dataclass(frozen=True, slots=True)
class ExternalTable:
    """The runs of a table in the order of their first rows; `lines` has the line of each (run, observable)."""

    runs: tuple[ScoredRun, ...]
    lines: Mapping[tuple[str, str], int]


def read_table(text: str, decomposition: Decomposition, source: str = "") -> ExternalTable:
    """Read a table of observations: CSV with a header.

    Columns: `run`, `observable`, `x`, and either `difficulty` or one column for each key factor of the
    decomposition, in the unit of its tables; optionally `considered`, `design_point` and `agent`. Raises
    SetupError with every fault and its line.
    """
    faults = _FaultLog(source)
    # Excel writes a byte order mark at the start of its CSV files.
    text = text.removeprefix("\ufeff")
    columns: dict[str, int] = {}
    rows = _csv_rows(text, columns, faults)
    # `_csv_rows` fills `columns` when it reads the header, so the first row must be taken before columns are
    # checked.
    first = next(rows, None)
    if first is None and not faults.faults:
        faults.add(1, "the table has no rows", "give one row for each run and observable")
    reader = _TableReader(decomposition, faults, columns)
    reader.check_columns()
    for row in chain(() if first is None else (first,), rows):
        reader.take(row)
    if faults.faults:
        raise SetupError(faults.faults, more=faults.more)
    return reader.table()


@dataclass(frozen=True, slots=True)
class _Row:
    """One record: its cells by column and the line on which it begins."""

    line: int
    cells: Mapping[str, str]


@dataclass(slots=True)
class _FaultLog:
    """The faults so far, with their lines; beyond MAX_FAULTS they are only counted."""

    source: str
    faults: list[Fault] = field(default_factory=list)
    more: int = 0

    def add(self, line: int, what: str, remedy: str) -> None:
        if len(self.faults) >= MAX_FAULTS:
            self.more += 1
            return
        self.faults.append(Fault(f"{self.source}:{line}" if self.source else f"line {line}", what, remedy))


def _csv_rows(text: str, columns: dict[str, int], faults: _FaultLog) -> Iterator[_Row]:
    """The records of a CSV text. Writes the names of the header and its line into `columns`."""
    # newline="" leaves line breaks inside quoted cells to the csv module, which counts them.
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    header: list[str] = []
    line = 1
    try:
        for cells in reader:
            start_line, line = line, reader.line_num + 1
            if not any(cell.strip() for cell in cells):
                continue
            values = [cell.strip() for cell in cells]
            if not header:
                header = values
                columns.update(dict.fromkeys(header, start_line))
                _check_header(header, start_line, faults)
            elif len(values) != len(header):
                faults.add(
                    start_line,
                    f"{len(values)} cells, and the header has {len(header)}",
                    "give one cell for each column",
                )
            else:
                yield _Row(start_line, dict(zip(header, values, strict=True)))
    except csv.Error as error:
        faults.add(reader.line_num, f"not valid CSV: {error}", "correct the quotes on that line")


def _check_header(header: list[str], line: int, faults: _FaultLog) -> None:
    for name in dict.fromkeys(name for name in header if header.count(name) > 1):
        faults.add(line, f"the column {name!r} appears twice", "keep one")
    # Spreadsheets write semicolons where the comma is the decimal sign.
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        faults.add(line, "the columns are not separated by commas", "write commas")


@dataclass(slots=True)
class _RunRows:
    """One run so far: the values in which all of its rows must agree, by column, and its observations."""

    line: int
    common: dict[str, Any]
    difficulties: dict[str, float] = field(default_factory=dict)
    observations: list[Observation] = field(default_factory=list)


class _TableReader:
    """Takes rows one by one, keeps the valid ones, and logs the faults of the others."""

    def __init__(self, decomposition: Decomposition, faults: _FaultLog, columns: Mapping[str, int]) -> None:
        self._decomposition = decomposition
        self._faults = faults
        self._columns = columns
        self._factors = [name for name in decomposition.factors() if name in columns]
        self._units = {row.factor: row.unit for rows in decomposition.tables.values() for row in rows}
        self._runs: dict[str, _RunRows] = {}
        self._lines: dict[tuple[str, str], int] = {}

    def check_columns(self) -> None:
        """Log missing and unknown columns."""
        if not self._columns:
            return
        allowed, first = (*KNOWN_COLUMNS, *self._decomposition.factors()), min(self._columns.values())
        for name, line in self._columns.items():
            if name not in allowed:
                self._faults.add(line, f"unknown column {name!r}", f"known: {', '.join(allowed)}")
        for name in REQUIRED_COLUMNS:
            if name not in self._columns:
                self._faults.add(first, f"the column {name!r} is missing", "add it")
        self._check_factors(first)
        self._check_difficulty(first)

    def _check_factors(self, first: int) -> None:
        """Log key factors of which a column could not be read in one way: their names may be anything."""
        units: dict[str, set[str]] = {}
        for rows in self._decomposition.tables.values():
            for row in rows:
                units.setdefault(row.factor, set()).add(row.unit)
        for name in self._factors:
            if name in KNOWN_COLUMNS:
                what = f"the key factor {name!r} of {self._decomposition.name} has the name of another column"
                self._faults.add(first, what, "rename the factor")
            if len(units[name]) > 1:
                what = f"the tables of {self._decomposition.name} give {name!r} in {', '.join(sorted(units[name]))}"
                self._faults.add(first, what, "use one unit in all tables")

    def _check_difficulty(self, first: int) -> None:
        needed = ", ".join(f"{name} ({self._units[name]})" for name in self._decomposition.factors())
        has_difficulty = "difficulty" in self._columns
        if has_difficulty and self._factors:
            also = ", ".join(self._factors)
            self._faults.add(
                first,
                f"the table has a difficulty and factor columns too: {also}",
                "keep either the difficulty or the factors",
            )
        if has_difficulty:
            return
        if not self._factors:
            remedy = (
                f"add it, or the key factors of {self._decomposition.name}: {needed}"
                if needed
                else "add it; the decomposition has no key factor tables"
            )
            self._faults.add(first, "the column 'difficulty' is missing", remedy)
        else:
            for name in self._decomposition.factors():
                if name not in self._columns:
                    self._faults.add(
                        first,
                        f"the factor column {name!r} is missing",
                        f"add it; every key factor is needed: {needed}",
                    )
            for name in self._decomposition.observables:
                if not self._decomposition.key_factors(name):
                    self._faults.add(
                        first,
                        f"{name} has no key factors in {self._decomposition.name}",
                        "give difficulties instead",
                    )

    def take(self, row: _Row) -> None:
        """Add one row to its run."""
        name, observable = self._id(row, "run"), self._id(row, "observable")
        considered = self._considered(row)
        x = self._number(row, "x", 0.0, 1.0, needed=considered is True) if "x" in self._columns else None
        stated = self._number(row, "difficulty", 0.0, 100.0) if "difficulty" in self._columns else None
        common: dict[str, Any] = {
            column: self._id(row, column) for column in ("agent", "design_point") if column in self._columns
        }
        common |= {column: self._number(row, column, -math.inf, math.inf) for column in self._factors}
        if observable is not None and observable not in self._decomposition.observables:
            names = ", ".join(self._decomposition.observables)
            self._faults.add(
                row.line,
                f"there is no observable {observable!r} in {self._decomposition.name}",
                f"known: {names}"[:400],
            )
            observable = None
        if name is None:
            return
        run = self._runs.setdefault(name, _RunRows(row.line, common))
        self._agree(row, name, run, common)
        if observable is None or considered is None:
            return
        if (name, observable) in self._lines:
            first_line = self._lines[name, observable]
            what = f"run {name!r} has {observable} already on line {first_line}"
            self._faults.add(row.line, what, "keep one of the rows")
            return
        self._lines[name, observable] = row.line
        if stated is not None:
            run.difficulties[observable] = stated
        # An invalid x was logged above; only valid rows become observations.
        if not (considered and x is None):
            run.observations.append(
                Observation(observable=observable, considered=considered, x=x if considered else None)
            )

    def table(self) -> ExternalTable:
        """All runs. Call it only when no fault was logged."""
        shared: dict[object, Difficulty] = {}
        replicates: dict[str, int] = {}
        runs = []
        for name, run in self._runs.items():
            point = run.common.get("design_point", name)
            # Replicates have no column; they are numbered in the order of their first rows.
            replicate = replicates[point] = replicates.get(point, -1) + 1
            runs.append(
                ScoredRun(
                    realization=name,
                    design_point=point,
                    replicate=replicate,
                    agent=run.common.get("agent", DEFAULT_AGENT),
                    outcome=Outcome.COMPLETED,
                    difficulty=self._difficulty(run, shared),
                    observations=tuple(run.observations),
                )
            )
        return ExternalTable(tuple(runs), self._lines)

    def _difficulty(self, run: _RunRows, shared: dict[object, Difficulty]) -> Difficulty:
        """The difficulty of a run; equal situations share one object, which makes scoring faster."""
        values = {name: run.common[name] for name in self._factors} or run.difficulties
        rate: Callable[[Decomposition, Mapping[str, float]], Difficulty] = (
            difficulty_of_values if self._factors else stated_difficulty
        )
        key = tuple(sorted(values.items()))
        if key not in shared:
            shared[key] = rate(self._decomposition, values)
        return shared[key]

    def _agree(self, row: _Row, name: str, run: _RunRows, common: Mapping[str, Any]) -> None:
        for column, value in common.items():
            stated = run.common[column]
            if value is not None and stated is not None and value != stated:
                what = f"run {name!r} has {column} {value!r} here and {stated!r} on line {run.line}"
                self._faults.add(
                    row.line, what, "give all rows of a run the same value, or the other run another id"
                )

    def _id(self, row: _Row, column: str) -> str | None:
        """The text of an id; None where it is invalid or its column is missing."""
        if column not in self._columns:
            return None
        if value := row.cells[column]:
            return value
        self._faults.add(row.line, f"{column} is empty", "name it")
        return None

    def _number(
        self, row: _Row, column: str, low: float, high: float, *, needed: bool = True
    ) -> float | None:
        """A number within bounds; None where it is invalid, or empty and not needed."""
        value = row.cells[column]
        if not value:
            if needed:
                where = " where considered is not false" if column == "x" else ""
                self._faults.add(row.line, f"{column} is empty{where}", "give a number")
            return None
        decimal = decimal_number(value)
        number = math.nan if decimal is None else float(decimal)
        if not math.isfinite(number):
            remedy = "write a decimal number with a point and without leading zeros"
            self._faults.add(row.line, f"{column} is {value!r}, which is not a number", remedy)
            return None
        if not low <= number <= high:
            what = f"{column} {number:g} lies outside {low:g} to {high:g}"
            self._faults.add(row.line, what, f"keep it in [{low:g}, {high:g}]")
            return None
        return number

    def _considered(self, row: _Row) -> bool | None:
        """Whether the run exercised the observable; None where the cell is invalid."""
        value = row.cells.get("considered", "")
        considered = _CONSIDERED_WORDS.get(value.lower())
        if considered is None:
            self._faults.add(
                row.line, f"considered is {value!r}", "write true, false, 1, 0, yes or no; empty is true"
            )
        return considered
