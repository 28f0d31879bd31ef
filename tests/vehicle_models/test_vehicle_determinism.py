"""The same SimSpec and the same client bytes give the same flight and the same bytes, wherever and
whenever.
"""

from __future__ import annotations

import hashlib
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from vehicle_client import Client, simspec

Make = Callable[..., Client]
SPEC = {
    "environment": {"wind": {"speed_mps": 5.0, "from_deg": 200.0, "turbulence_mps": 5.0}},
    "vehicle": {"gps": {"wander_m": 2.0, "noise_m": 0.1}},
}


def digests(make: Make, seed: int = 5) -> tuple[str, str]:
    """Fly a short offboard flight; SHA-256 of everything on the wire and of the true track."""
    wire, track = hashlib.sha256(), hashlib.sha256()

    def tap(link: str, direction: str, data: bytes) -> None:
        wire.update(direction.encode() + data)

    client = make(simspec(**SPEC, seeds={"root": seed}), streams="onboard", tap=tap)  # type: ignore[arg-type]
    client.airborne(5.0)
    client.offboard(8, 4, -6)
    for step in range(60):
        client.fly(0.1, lambda: client.setpoint(8, 4 if step % 20 < 10 else -4, -6))  # noqa: B023
        truth = client.vehicle.truth()
        track.update(struct.pack("<6d", *truth.position_enu_m, *truth.velocity_enu_mps))
    return wire.hexdigest(), track.hexdigest()


def test_two_vehicles_with_one_plan_are_identical(make: Make) -> None:
    """Byte log and trajectory agree for two vehicles in one process, and differ with another seed."""
    first, second, other = digests(make), digests(make), digests(make, seed=6)
    assert first == second
    assert first[0] != other[0]
    assert first[1] != other[1]


def test_another_process_flies_the_same(make: Make) -> None:
    """A fresh interpreter with another hash seed, another clock and another working directory agrees too."""
    here = Path(__file__).parent
    code = "from contextlib import ExitStack; import vehicle_client, test_vehicle_determinism as t; "
    code += "g = vehicle_client.make.__wrapped__(); print(*t.digests(next(g)))"
    environment = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": str(here)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert tuple(done.stdout.split()) == digests(make)


def test_jsbsim_is_silent_and_writes_nothing(tmp_path: Path) -> None:
    """Building and flying a vehicle prints nothing and leaves nothing in the working directory."""
    code = "from vehicle_models import open_x500; from bench.simulation import StandalonePlan, standalone_simspec; from bench.contracts import VehiclePlan\n"
    code += "with open_x500(VehiclePlan(standalone_simspec(StandalonePlan(home=(47.0, 8.0, 400.0, 0.0))), ())) as v:\n"
    code += "    for _ in range(100): v.step()\n"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")
    assert list(tmp_path.iterdir()) == []
