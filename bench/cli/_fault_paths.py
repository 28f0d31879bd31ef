"""Faults of paths that the user gave, and of documents whose finder did not know their file."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import Fault, SetupError

_PATH_ERRORS = {
    errno.EACCES: ("is closed to this user", "correct its permissions, or name another path"),
    errno.EPERM: ("is closed to this user", "correct its permissions, or name another path"),
    errno.EROFS: ("lies on a file system that cannot be written", "name a path elsewhere"),
    errno.ENOENT: ("does not exist", "correct the path"),
    errno.EISDIR: ("is a folder", "name a file"),
    errno.EEXIST: ("exists already", "name another path"),
    errno.ENOTDIR: ("lies below something that is no folder", "correct the path"),
    errno.ENAMETOOLONG: ("has a name that is too long", "shorten it"),
    errno.ELOOP: ("is a link that leads back to itself", "remove the link, or name another path"),
}


def path_fault(error: OSError) -> Fault | None:
    """What is wrong with the path of an error of the operating system; None if the error is about no path."""
    if error.errno not in _PATH_ERRORS or not error.filename:
        return None
    path = Path(os.fsdecode(error.filename))
    what, remedy = _PATH_ERRORS[error.errno]
    # The path may be one that the bench makes in what the user named: it is told what is in the way.
    for part in reversed((path, *path.parents)):
        if error.errno in (errno.EEXIST, errno.ENOTDIR, errno.ENOENT) and os.path.lexists(part):
            if not os.path.exists(part):
                lead = f"is a link to {os.readlink(part)}, which does not exist"
                return Fault(str(part), lead, "remove the link, or make what it leads to")
            if not os.path.isdir(part):
                return Fault(str(part), "is no folder", "name a folder")
    return Fault(str(path), what, remedy)


def require_new(path: Path) -> None:
    """Raises SetupError for a path that exists, also as a link that leads nowhere."""
    if os.path.lexists(path):
        raise SetupError(path, "already exists and is not overwritten", "name another file")


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
