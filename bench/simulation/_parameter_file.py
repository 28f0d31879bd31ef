"""Parameters that outlive the process: what differs from the defaults, in a JSON file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from bench.documents import parse_text, read_text
from bench.errors import SetupError


class ParameterFile:
    """A file of parameter names and numbers. A file that does not exist yet counts as empty."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._saved: Mapping[str, float] | None = None

    def load(self) -> dict[str, float]:
        """The saved values. Raises SetupError for a file that holds anything else."""
        # As `exists` follows links, one that leads nowhere is no file yet either: `save` puts one in its place.
        if not self._path.exists():
            return {}
        parameters, _ = parse_text(read_text(self._path), str(self._path))
        numbers = isinstance(parameters, dict) and all(
            isinstance(number, int | float) and not isinstance(number, bool) for number in parameters.values()
        )
        if not numbers:
            raise SetupError(str(self._path), "holds more than names and numbers", "fix or remove it")
        return {name: float(value) for name, value in parameters.items()}

    def save(self, values: Mapping[str, float]) -> None:
        """Write the values if they have changed, all of them or none.

        Raises SetupError when the file cannot be written.
        """
        if values == self._saved:
            return
        temporary = self._path.with_name(f"{self._path.name}.new")
        try:
            temporary.write_text(json.dumps(dict(values), indent=1, sort_keys=True) + "\n", encoding="utf-8")
            os.replace(temporary, self._path)
        except OSError as error:
            raise SetupError(
                str(self._path), f"cannot be written: {error}", "name a file in a folder of yours"
            ) from None
        self._saved = dict(values)


@runtime_checkable
class HasParameters(Protocol):
    """A vehicle whose parameters can be saved."""

    def changed_parameters(self) -> Mapping[str, float]:
        """What differs from the defaults."""
