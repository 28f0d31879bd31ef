"""Faults that name the file which the user gave, where the code that found them did not know it."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import Fault, SetupError


@contextmanager
def named(path: Path) -> Generator[None]:
    """Put the file before every fault of a field of its document; what is about another place stays as it is."""
    try:
        yield
    except SetupError as error:
        raise SetupError([_of(path, fault) for fault in error.faults]) from None


def _of(path: Path, fault: Fault) -> Fault:
    from bench.campaign import Campaign
    from bench.simspec import SimSpec

    field = re.split(r"[.\[: ]", fault.where, maxsplit=1)[0]
    known = field in Campaign.model_fields or field in SimSpec.model_fields or fault.where.startswith("design point ")
    return Fault(f"{path}: {fault.where}", fault.what, fault.remedy) if known else fault
