"""What a decomposition asks the measures for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench.contracts import Option
from bench.simspec import FACTORS
from decompositions import Decomposition, Vocabulary, load_decomposition
from test_ports import check_options


def load_asked(name_or_path: str | Path) -> Decomposition:
    """A decomposition that can be measured here: factors, units, measures and options are checked as the document is.

    Raises SetupError with every fault at once.
    """
    return load_decomposition(name_or_path, Vocabulary({name: factor.unit for name, factor in FACTORS.items()}, check_options))


def measures_of(decomposition: Decomposition) -> dict[str, tuple[str, Mapping[str, Option]]]:
    """Measure and options of every distinct observable, by its id."""
    return {one.id: (one.measure, one.options) for one in decomposition.observables.values()}
