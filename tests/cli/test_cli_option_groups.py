"""Options that stand in frozen dataclasses are read as any others, and reach the command as one object."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from bench.cli._option_groups import grouped


@dataclass(frozen=True, slots=True)
class Wind:
    speed_mps: Annotated[float, typer.Option(min=0.0)] = 3.0
    gusts: Annotated[list[str] | None, typer.Option(metavar="SPAN")] = None


@dataclass(frozen=True, slots=True)
class Weather:
    fog: Annotated[bool, typer.Option("--fog")] = False
    wind: Wind = field(default_factory=Wind)
    cloud: str = "none"


@pytest.mark.parametrize(
    ("arguments", "weather"),
    [
        ([], Weather()),
        (["--fog", "--cloud", "low"], Weather(fog=True, cloud="low")),
        (["--gusts", "a", "--speed-mps", "7", "--gusts", "b"], Weather(wind=Wind(7.0, ["a", "b"]))),
    ],
)
@pytest.mark.parametrize("seed", [0, 4])
def test_fields_are_options_and_objects_come_back(arguments: list[str], weather: Weather, seed: int) -> None:
    """Beside two parameters of the command's own, before and behind the group."""
    calls: list[tuple[str, Weather, int]] = []

    def look(place: str, weather: Weather, seed: Annotated[int, typer.Option(min=0)] = 0) -> None:
        """Look at the weather."""
        calls.append((place, weather, seed))

    # Annotations of a function in a function name what this module does not have.
    look.__annotations__ |= {"weather": Weather}
    app = typer.Typer()
    app.command()(grouped(look))
    options = [*arguments, "--seed", str(seed)] if seed else arguments
    assert CliRunner().invoke(app, ["here", *options]).exit_code == 0
    assert calls == [("here", weather, seed)]
    assert CliRunner().invoke(app, ["here", "--speed-mps", "-1"]).exit_code == 2
    assert "Look at the weather." in CliRunner().invoke(app, ["--help"]).output
