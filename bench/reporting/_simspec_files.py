"""The SimSpecs of a campaign, read when they are asked for: all of 20,000 at once would take more than 3 GB."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from bench.contracts import parse_document
from bench.simspec import SimSpec

# As parsed, a SimSpec takes some 160 kB (measured on the demo's), and reading it again 1 ms.
KEPT_SIMSPECS = 256


class SimSpecFiles(Mapping[str, SimSpec]):
    """SimSpecs by realization, each parsed from its file; the first `KEPT_SIMSPECS` are kept.

    Asking for one whose file is damaged or missing is a KeyError.
    """

    def __init__(self, paths: Mapping[str, Path], kept: int = KEPT_SIMSPECS) -> None:
        self._paths = dict(paths)
        self._kept = kept
        self._parsed: dict[str, SimSpec] = {}

    def __getitem__(self, realization: str) -> SimSpec:
        if (known := self._parsed.get(realization)) is not None:
            return known
        try:
            simspec = parse_document(SimSpec, self._paths[realization].read_bytes())
        except OSError as error:
            raise KeyError(realization) from error
        if simspec is None:
            raise KeyError(realization)
        if len(self._parsed) < self._kept:
            self._parsed[realization] = simspec
        return simspec

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
        return chosen
