"""What a decomposition asks the measures for."""

from __future__ import annotations

from collections.abc import Mapping

from bench.contracts import Option
from bench.errors import Fault, SetupError
from decompositions import Decomposition
from test_ports import check_options


def measures_of(decomposition: Decomposition) -> dict[str, tuple[str, Mapping[str, Option]]]:
    """Measure and options of every distinct observable, by its id."""
    return {one.id: (one.measure, one.options) for one in decomposition.observables()}


def check_measures(decomposition: Decomposition) -> None:
    """Make sure that every observable can be measured here. Raises SetupError with a fault for each that cannot."""
    faults = []
    for observable, (measure, options) in measures_of(decomposition).items():
        try:
            check_options(measure, options)
        except (SetupError, ValueError) as error:
            faults.append(Fault(f"{decomposition.name}: {observable}", str(error), "correct the measure or its options"))
    if faults:
        raise SetupError(faults)
