"""The option --executor: where the sessions of a campaign fly."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING

from bench.errors import Fault, SetupError

if TYPE_CHECKING:
    from bench.campaign import OpenExecutor


def executor_named(option: str, workers: int | None, recordings: str | None = None) -> OpenExecutor:
    """What opens the executor of `local`, `dask` or `dask=ADDRESS`, whose workers keep recordings below the URL
    `recordings`. Raises SetupError for any other text, and for recordings of local sessions.
    """
    from bench.campaign import check_store, open_dask, open_local_pool

    name, has_address, address = option.partition("=")
    if option == "local" and recordings is not None:
        what = "is for sessions on a cluster; those of this machine are recorded into the campaign's folder"
        raise SetupError(Fault("--recordings", what, "give --executor dask too, or --out for another folder"))
    if option == "local":
        return open_local_pool
    if name != "dask" or (has_address and not address):
        raise SetupError(
            Fault(
                "--executor",
                f"{option!r} is not available",
                "give local, dask (worker processes on this machine), or dask=ADDRESS of a Dask scheduler, "
                "for example dask=tcp://node1:8786",
            )
        )
    if recordings is not None:
        check_store("--recordings", recordings)
    # A cluster has as many sessions at once as it has threads, unless --workers says less; this machine's cores
    # say nothing about it.
    return partial(open_dask, address=address or None, at_most=workers, recordings=recordings, warn=_warn)


def _warn(warning: str) -> None:
    print(f"WARNING: {warning}", file=sys.stderr, flush=True)
