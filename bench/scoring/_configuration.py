"""Difficulty configurations: runs whose studied key attributes are equally hard (docs/rulings.md 14, 15)."""

from __future__ import annotations

from collections.abc import Sequence

from bench.errors import Fault, SetupError
from bench.statistics import DIFFICULTY_DECIMALS
from decompositions import Decomposition, Level

from ._difficulty import Difficulty, Standing


def studied_key_attributes(decomposition: Decomposition, study: Sequence[str] = ()) -> tuple[str, ...]:
    """The key attributes under study: those in `study`, else the decomposition's.

    Raises SetupError for any other node.
    """
    available = decomposition.at_level(Level.KEY_ATTRIBUTE)
    unknown = [node for node in study if node not in available]
    if unknown:
        raise SetupError(
            [
                Fault("study", f"there is no key attribute {node!r}", f"known: {', '.join(available)}")
                for node in unknown
            ]
        )
    return tuple(study) or decomposition.study


def configuration_of(decomposition: Decomposition, difficulty: Difficulty, study: Sequence[str] = ()) -> str:
    """The key of a difficulty configuration, for example `KA-03=25.333333 KA-05=55 KA-09=none`; with at most
    six decimals. `none` is a key attribute that the configuration does not exercise, `unknown` one of which no
    difficulty is stated.

    Raises as `studied_key_attributes`.
    """
    return " ".join(
        f"{node}={_compact(decomposition, difficulty, node)}"
        for node in studied_key_attributes(decomposition, study)
    )


def configuration_tension(
    decomposition: Decomposition, difficulty: Difficulty, study: Sequence[str] = ()
) -> int | None:
    """Tension 1 to 5 of a configuration: the minimum over the studied nodes with a difficulty, None without any."""
    tensions = [difficulty.nodes[node].tension for node in studied_key_attributes(decomposition, study)]
    return min((tension for tension in tensions if tension is not None), default=None)


def _compact(decomposition: Decomposition, difficulty: Difficulty, node: str) -> str:
    value = difficulty.of(node)
    if value is None:
        leaves = decomposition.observables_under(node)
        stated = any(difficulty.observables[leaf].standing is Standing.COUNTED for leaf in leaves)
        return "unknown" if stated else "none"
    # Interpolated ratings differ in their last bits between equal situations; the key must not.
    return f"{value:.{DIFFICULTY_DECIMALS}f}".rstrip("0").rstrip(".")
