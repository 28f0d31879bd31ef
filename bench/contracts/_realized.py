"""The places of a SimSpec that has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.errors import SetupError

if TYPE_CHECKING:
    from bench.simspec import Realized, SimSpec


def realized_of(simspec: SimSpec) -> Realized:
    """The places of a SimSpec. Raises SetupError when it has none."""
    if simspec.realized is None:
        raise SetupError(
            simspec.name,
            "the SimSpec is not realized",
            "place it first (rebar realize, or bench.realization.place)",
        )
    return simspec.realized
