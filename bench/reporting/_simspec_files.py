"""The SimSpecs of a campaign, read when they are asked for: all of 20,000 at once would take more than 3 GB."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from bench.contracts import parse_document
from bench.documents import read_bytes
from bench.errors import SetupError
from bench.simspec import SimSpec

# As parsed, a SimSpec takes some 160 kB (measured on the demo's), and reading it again 1 ms.
KEPT_SIMSPECS = 256
_NOT_OF_SITUATION = {"name", "agent", "seeds", "realized"}


class SimSpecFiles(Mapping[str, SimSpec]):
    """SimSpecs by realization, each parsed from its file; the first `KEPT_SIMSPECS` are kept, and one of each of the first
    `KEPT_SIMSPECS` situations.

    Asking for one whose file is damaged or missing is a KeyError.
    """

    def __init__(self, paths: Mapping[str, str | os.PathLike[str]], kept: int = KEPT_SIMSPECS) -> None:
        # As texts: a Path takes four times as much.
        self._paths = {name: os.fspath(path) for name, path in paths.items()}
        self._kept = kept
        self._parsed: dict[str, SimSpec] = {}
        self._distinct: dict[bytes, SimSpec] = {}
        self._situations: dict[str, SimSpec] = {}

    def __getitem__(self, realization: str) -> SimSpec:
        if (known := self._parsed.get(realization)) is not None:
            return known
        try:
            simspec = parse_document(SimSpec, read_bytes(Path(self._paths[realization])))
        except SetupError as error:
            raise KeyError(realization) from error
        if simspec is None:
            raise KeyError(realization)
        if len(self._parsed) < self._kept:
            self._parsed[realization] = simspec
        self._note_situation(realization, simspec)
        return simspec

    def situation(self, realization: str) -> SimSpec:
        """A SimSpec with the same situation: it may have another name, agent, seeds and places. KeyError as above."""
        known = self._situations.get(realization)
        return self[realization] if known is None else known

    def _note_situation(self, realization: str, simspec: SimSpec) -> None:
        # Replicates and agents share their situation, so most files need to be read only once.
        key = hashlib.sha256(simspec.model_dump_json(exclude=_NOT_OF_SITUATION).encode()).digest()
        if key in self._distinct or len(self._distinct) < self._kept:
            self._situations[realization] = self._distinct.setdefault(key, simspec)

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def __contains__(self, realization: object) -> bool:
        # By name: the mapping of a report has only those that could be read, see `of`.
        return realization in self._paths

    def of(self, realizations: Iterable[str]) -> SimSpecFiles:
        """Those of some realizations, without looking at their files."""
        chosen = SimSpecFiles(
            {name: self._paths[name] for name in realizations if name in self._paths}, self._kept
        )
        chosen._parsed = {name: simspec for name, simspec in self._parsed.items() if name in chosen._paths}
        chosen._distinct = self._distinct
        chosen._situations = {
            name: simspec for name, simspec in self._situations.items() if name in chosen._paths
        }
        return chosen


def situations_of(simspecs: Mapping[str, SimSpec]) -> Iterator[tuple[str, SimSpec]]:
    """Each realization with a SimSpec of its situation; see `SimSpecFiles.situation`."""
    if isinstance(simspecs, SimSpecFiles):
        yield from ((name, simspecs.situation(name)) for name in simspecs)
    else:
        yield from simspecs.items()
