"""Reading a SimSpec from a file."""

from __future__ import annotations

from pathlib import Path

from bench.documents import load_document
from bench.errors import SetupError

from ._assets import asset_fault
from ._document import SimSpec, is_manifest_file


def load_simspec(path: Path | str) -> SimSpec:
    """Read a SimSpec from YAML or JSON. A relative path of its agent's manifest is relative to its own folder.

    Raises SetupError with every fault: file, line, field and remedy.
    """
    spec = load_document(path, SimSpec)
    places = ((f"{path}: actors[{index}].asset", group.asset) for index, group in enumerate(spec.actors))
    if faults := [fault for where, asset in places if (fault := asset_fault(where, asset))]:
        raise SetupError(faults)
    if not is_manifest_file(spec.agent.manifest):
        return spec
    # Absolute: the SimSpec is flown from other folders.
    manifest = str(Path(path).resolve().parent / spec.agent.manifest)
    return spec.model_copy(update={"agent": spec.agent.model_copy(update={"manifest": manifest})})
