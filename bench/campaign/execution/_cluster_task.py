"""What the runner and the workers of a Dask cluster send each other."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from decompositions import DecompositionDocument

# Fields of the message that a worker has started a task. Not `worker`: the scheduler sets that to the address.
STARTED = "session_started"
"""The task's key."""
NAME = "name"
"""The worker's name: its machine and its address."""


class ClusterTask(BaseModel):
    """A task with everything that it needs: a cluster's machines share no disk with the runner.

    `runner` is the topic on the scheduler where the runner learns which worker has started the task, `recordings` the URL
    below which the recording is kept; None sends it back.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    realization: str
    simspec: str
    decomposition: DecompositionDocument
    job: str
    wall_s: float
    own_network: bool
    versions: dict[str, str]
    runner: str
    recordings: str | None = None


class StoredRecording(BaseModel):
    """Where a worker has put a recording; or why it could not, so that the recording comes back instead."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    url: str
    bytes: int
    fault: str = ""
