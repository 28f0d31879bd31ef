"""A package that is installed from outside joins every family of plug-ins."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from installed_packages import DECOMPOSITION

from bench.simspec import Pace, Point, Polygon, SimSpec, VehicleSpec, World

FLY = """
import json, sys
from pathlib import Path
from bench.campaign import fly_realization
from bench.campaign._overhead import fly_overhead
from bench.contracts import plugins
from bench.simspec import AgentSpec, Perception, Point, Polygon, SimSpec, VehicleSpec, World
from decompositions import read_decomposition

square = Polygon(corners=tuple(Point(east_m=x, north_m=y) for x, y in ((0, 0), (90, 0), (90, 90), (0, 90))))
spec = SimSpec(name="outside", world=World(area=square, scene="outside_empty"), vehicle=VehicleSpec(model="outside_still"),
               perception=Perception(source="detector", detector="outside_detector"),
               agent=AgentSpec(manifest="outside_agent"))
decomposition = read_decomposition(Path(sys.argv[1]).read_text())
result = fly_realization(spec, decomposition, Path(sys.argv[2]), "outside")
simulated = spec.model_copy(update={"perception": Perception()})
(predicted,) = fly_overhead([simulated], ["outside"], decomposition)
boats = [{"id": "ferry", "asset": "outside-ferry", "count": 1}, {"id": "buoy", "asset": "outside-buoy", "role": "clutter", "count": 1}]
harbour = SimSpec.model_validate({"name": "harbour", "world": spec.world.model_dump(), "actors": boats})
print(json.dumps({"harbour": harbour.model_dump(mode="json"), "predicted": [o.model_dump(mode="json") for o in predicted.observations], "outcome": result.outcome, "detector": result.facts["detector"].description, "reason": result.reason, "observations": [o.model_dump(mode="json") for o in result.observations]}))
"""


def test_an_outside_package_joins_every_family(site: Path, tmp_path: Path) -> None:
    """Installed by pip into a folder of its own, its plug-ins are found and used: all but the surrogate in a
    session, that beside it.
    """
    decomposition = tmp_path / "decomposition.yaml"
    decomposition.write_text(DECOMPOSITION)
    script = tmp_path / "fly.py"
    script.write_text(f"import site; site.addsitedir({str(site)!r})\n" + FLY)
    command = [sys.executable, str(script), str(decomposition), str(tmp_path / "run")]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    result = json.loads(completed.stdout)
    assert result["outcome"] == "completed", result["reason"]
    assert result["observations"] == [{"observable": "OBS-1", "considered": True, "x": 0.0, "evidence": []}]
    assert result["predicted"] == result["observations"]
    # Carried by the SimSpec, which is read here, where the package is not.
    harbour = SimSpec.model_validate(result["harbour"])
    groups = [(group.role, group.definition.length_m) for group in harbour.actors]
    assert groups == [("bystander", 40.0), ("clutter", 2.0)]
    assert result["detector"] == "outside_detector (rebar-outside 0.0.1): sky 3"


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


def test_an_installed_board_package_is_found_by_its_name(site: Path, tmp_path: Path) -> None:
    """The bench asks the package what a SimSpec says of a board."""
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
