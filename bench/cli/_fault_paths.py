"""Adds the file that the user gave to faults whose finder did not know it."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import Fault, SetupError


@contextmanager
def file_in_faults(path: Path) -> Generator[None]:
    """Put the file before every fault of a field of its document. Faults of other places stay as they are."""
    try:
        yield
    except SetupError as error:
        raise SetupError([_with_file(path, fault) for fault in error.faults]) from None


def _with_file(path: Path, fault: Fault) -> Fault:
    from bench.campaign import Campaign
    from bench.simspec import SimSpec

    # A fault begins with the field of the document, as in `design.factors[0]: ...` or `actors[people].count:
    # ...`.
    field = re.split(r"[.\[: ]", fault.where, maxsplit=1)[0]
    is_document = (
        field in Campaign.model_fields
        or field in SimSpec.model_fields
        or fault.where.startswith("design point ")
    )
    return Fault(f"{path}: {fault.where}", fault.what, fault.remedy) if is_document else fault
