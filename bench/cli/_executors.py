"""Options that say where the sessions of a campaign fly."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

if TYPE_CHECKING:
    from bench.campaign import OpenExecutor

Workers = Annotated[int | None, typer.Option(min=1, help="Sessions at once. Default: the number of cores")]


@dataclass(frozen=True, slots=True)
class ExecutorOptions:
    """`local`, `dask` or `dask=ADDRESS`, and the URL below which the workers of a cluster keep recordings."""

    workers: Workers = None
    executor: Annotated[
        str,
        typer.Option(
            metavar="local|dask[=ADDRESS]",
            help="Where sessions fly: in processes of this machine, or on a Dask cluster",
        ),
    ] = "local"
    recordings: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Where workers of a Dask cluster put the recordings, for example s3://bucket/folder. Default: they come back",
        ),
    ] = None

    def opener(self) -> OpenExecutor:
        """What opens the executor. Raises SetupError for any other text, and for recordings of local sessions."""
        from bench.campaign import check_store, open_dask, open_local_pool

        name, has_address, address = self.executor.partition("=")
        if self.executor == "local" and self.recordings is not None:
            what = (
                "is for sessions on a cluster; those of this machine are recorded into the campaign's folder"
            )
            raise SetupError("--recordings", what, "give --executor dask too, or --out for another folder")
        if self.executor == "local":
            return open_local_pool
        if name != "dask" or (has_address and not address):
            raise SetupError(
                "--executor",
                f"{self.executor!r} is not available",
                "give local, dask (worker processes on this machine), or dask=ADDRESS of a Dask scheduler, "
                "for example dask=tcp://node1:8786",
            )
        if self.recordings is not None:
            check_store("--recordings", self.recordings)
        # A cluster has as many sessions at once as it has threads, unless --workers says less; this machine's cores
        # say nothing about it.
        return partial(
            open_dask, address=address or None, at_most=self.workers, recordings=self.recordings, warn=warn
        )


def warn(warning: str) -> None:
    """Print a warning, to stderr."""
    print(f"WARNING: {warning}", file=sys.stderr, flush=True)
