"""Reading a SimSpec from a file."""

from __future__ import annotations

from pathlib import Path

from bench.documents import load_document
from bench.errors import SetupError

from ._assets import asset_fault
from ._document import SimSpec


def load_simspec(path: Path | str) -> SimSpec:
    """Read a SimSpec from YAML or JSON. Raises SetupError with every fault: file, line, field and remedy."""
    spec = load_document(path, SimSpec)
    places = ((f"{path}: actors[{index}].asset", group.asset) for index, group in enumerate(spec.actors))
    if faults := [fault for where, asset in places if (fault := asset_fault(where, asset))]:
        raise SetupError(faults)
    return spec
