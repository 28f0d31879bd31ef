"""The face of the package: what it declares is what it gives."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import bench


def test_every_declared_name_can_be_had() -> None:
    """Each name of the face is fetched from the room that owns it."""
    for name in bench.__all__:
        assert getattr(bench, name).__name__ == name


def test_the_type_checker_sees_the_same_names() -> None:
    """The names under TYPE_CHECKING and those fetched at run time are one list."""
    tree = ast.parse(Path(bench.__file__ or "").read_text())
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    declared = {
        alias.asname: node.module
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert declared == bench._HOME


def test_importing_the_face_imports_no_room() -> None:
    """`import bench` costs next to nothing: no simulator, no middleware."""
    code = (
        "import bench, sys; print([m for m in ('jsbsim', 'zenoh', 'numpy', 'pydantic') if m in sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


def test_an_unknown_name_is_an_attribute_error() -> None:
    """A typing error in an import says so."""
    with pytest.raises(AttributeError, match="no_such_thing"):
        bench.no_such_thing  # noqa: B018


LAZY_ROOMS = [
    *(
        f"bench.{room}"
        for room in ("campaign", "contracts", "perception", "realization", "recording", "scoring")
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
        alias.asname: node.module
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert declared == module._MODULES
    assert all(hasattr(module, name) for name in module._MODULES)
    with pytest.raises(AttributeError, match="no_such_thing"):
        module.no_such_thing  # noqa: B018


def test_rating_difficulty_imports_no_statistics() -> None:
    """Each runner and most commands rate difficulty; scipy and polars take longer to import than all else."""
    code = "from bench.scoring import difficulty_of; import sys; print([m for m in ('scipy', 'polars') if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
