"""Boards join by pip, as any firmware from outside."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from boards import PACKAGE
from test_plugins_outside import install_outside

from bench.simspec import Pace, Point, Polygon, SimSpec, VehicleSpec, World

OPEN = """
import site, sys
site.addsitedir(sys.argv[1])
from bench.contracts import VehiclePlan, package_of
from bench.errors import SetupError
from bench.simspec import SimSpec
from vehicle_models import open_x500
print(package_of("rebar.firmware", "px4-board"))
try:
    with open_x500(VehiclePlan(SimSpec.model_validate_json(sys.argv[2]), ())):
        print("opened")
except SetupError as error:
    print(error)
"""


@pytest.mark.process
def test_an_installed_board_package_is_found_by_its_name(tmp_path: Path) -> None:
    """Into a folder of its own: the bench asks the package what a SimSpec says of a board."""
    site = install_outside(PACKAGE, tmp_path / "site")
    corners = tuple(Point(east_m=x, north_m=y) for x, y in ((0, 0), (90, 0), (90, 90)))
    options = {"device": str(tmp_path / "none")}
    spec = SimSpec(
        name="board",
        world=World(area=Polygon(corners=corners)),
        vehicle=VehicleSpec.model_validate({"autopilot": {"kind": "px4-board", "options": options}}),
        pace=Pace(mode="realtime"),
    )
    command = [sys.executable, "-c", OPEN, str(site), spec.model_dump_json()]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    package, fault = done.stdout.splitlines()
    assert package == "rebar-boards"
    assert fault.startswith(f"vehicle.autopilot.options.device: there is no device {tmp_path / 'none'} (")
