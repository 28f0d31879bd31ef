"""Difficulty configurations: groups of runs in which the studied key attributes are equally hard
(docs/rulings.md 14, 15).
"""

from __future__ import annotations

from collections.abc import Sequence

from bench.errors import Fault, SetupError
from bench.statistics import DIFFICULTY_DECIMALS
from decompositions import Decomposition, Level

from ._difficulty import Difficulty, tension_of


def studied_key_attributes(decomposition: Decomposition, study: Sequence[str] = ()) -> tuple[str, ...]:
    """The key attributes under study: those in `study`, else the decomposition's.

    Raises SetupError for any other node.
    """
    known = decomposition.at_level(Level.KEY_ATTRIBUTE)
    unknown = [node for node in study if node not in known]
    if unknown:
        raise SetupError(
            [
                Fault("study", f"there is no key attribute {node!r}", f"known: {', '.join(known)}")
                for node in unknown
            ]
        )
    return tuple(study) or decomposition.study


def configuration_of(decomposition: Decomposition, difficulty: Difficulty, study: Sequence[str] = ()) -> str:
    """The key of a difficulty configuration, for example `KA-03=25.333333 KA-05=55`; with at most six
    decimals.

    Raises as `studied_key_attributes`.
    """
    return " ".join(
        f"{node}={_compact(difficulty.of(node))}" for node in studied_key_attributes(decomposition, study)
    )


def configuration_tension(
    decomposition: Decomposition, difficulty: Difficulty, study: Sequence[str] = ()
) -> int:
    """Tension 1 to 5 of a configuration: the minimum over the nodes under study."""
    return min(tension_of(difficulty.of(node)) for node in studied_key_attributes(decomposition, study))


def _compact(value: float) -> str:
    # Interpolated ratings differ in their last bits between equal situations; the key must not.
    return f"{value:.{DIFFICULTY_DECIMALS}f}".rstrip("0").rstrip(".")
