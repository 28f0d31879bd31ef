"""Which rung an agent is started on."""

from __future__ import annotations

from functools import cache

from bench.contracts import AgentManifest
from bench.errors import SetupError
from bench.simspec import AgentSpec, Isolation

from ._container import Container
from ._landlock import Landlock
from ._rung import Rung
from ._unconfined import Unconfined

# From the strongest; `auto` takes the first of AUTOMATIC that a trial start shows to work.
AUTOMATIC = ("landlock", "none")
CONTAINER = "container"


@cache
def rungs() -> dict[str, Rung]:
    """Every rung by name, from the strongest. One set a process, so that each trial start runs once."""
    return {rung.name: rung for rung in (Landlock(), Container(), Unconfined())}


def rung_of(manifest: AgentManifest, agent: AgentSpec) -> Rung:
    """The rung for an agent: what the SimSpec or campaign demands, else what its manifest asks for.

    Raises SetupError if that cannot start here.
    """
    if agent.isolation is not None:
        return _rung(agent.isolation, "agent.isolation", manifest)
    return _rung(manifest.isolation, f"{manifest.name}: isolation", manifest)


def _rung(isolation: Isolation, where: str, manifest: AgentManifest) -> Rung:
    if isolation == "auto":
        return next(rungs()[name] for name in AUTOMATIC if rungs()[name].trial() is None)
    rung = rungs()[isolation]
    if isolation == CONTAINER and not manifest.image:
        raise SetupError(
            where, f"the manifest of {manifest.name} names no image to run", "add image: NAME:TAG to it"
        )
    if reason := rung.trial():
        working = [name for name, other in rungs().items() if other.trial() is None]
        raise SetupError(
            where, f"{isolation} cannot start here: {reason}", f"here work: {', '.join(working)}"
        )
    return rung
