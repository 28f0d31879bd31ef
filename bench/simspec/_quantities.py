"""Types of names and numbers that the parts of a SimSpec share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

# Ids become parts of file names and command lines, so they contain nothing that needs quoting.
Identifier = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,62}$")]
RosName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,62}$")]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Metres = Annotated[float, Field(ge=-1e5, le=1e5)]
