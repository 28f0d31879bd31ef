"""The face of the package: what it declares is what it gives."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import bench
from bench.lazy import declared_names


def test_every_declared_name_can_be_had() -> None:
    for name in bench.__all__:
        assert getattr(bench, name).__name__ == name


@pytest.mark.parametrize(
    ("statement", "unwanted"),
    [
        # No simulator, no middleware.
        ("import bench", {"jsbsim", "zenoh", "numpy", "pydantic"}),
        # Each runner and most commands rate difficulty; scipy and polars take longer to import than all else.
        ("from bench.scoring import difficulty_of", {"scipy", "polars"}),
        # Stratified designs and `rebar tension` rate by measured difficulty.
        ("from bench.reporting import measured_rating", {"scipy", "jinja2", "networkx"}),
        # Agents use it.
        ("import bench.polygons", {"numpy", "shapely"}),
    ],
)
def test_an_import_brings_no_more_than_it_needs(statement: str, unwanted: set[str]) -> None:
    code = f"import sys; {statement}; print(sys.modules.keys() & {unwanted})"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "set()"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_thing"):
        bench.no_such_thing  # noqa: B018


LAZY_ROOMS = [
    "bench",
    *(
        f"bench.{room}"
        for room in (
            "campaign",
            "contracts",
            "perception",
            "realization",
            "recording",
            "reporting",
            "scoring",
        )
    ),
    *(f"bench.{room}" for room in ("simspec", "statistics", "streams")),
    *("bench.realization.design", "bench.realization.placement", "decompositions"),
    "agent_adapters.reference",
]


@pytest.mark.parametrize("room", LAZY_ROOMS)
def test_rooms_give_each_declared_name_at_its_first_use(room: str) -> None:
    """The names under TYPE_CHECKING are those fetched at run time, each from the module that has it."""
    module = import_module(room)
    tree = ast.parse(Path(module.__file__ or "").read_text())
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    declared = {
        alias.asname: "." * node.level + (node.module or "")
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert declared == declared_names(room)
    assert all(hasattr(module, name) for name in declared_names(room))
    with pytest.raises(AttributeError, match="no_such_thing"):
        module.no_such_thing  # noqa: B018
