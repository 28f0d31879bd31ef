"""The made recordings themselves: what is written is what is measured."""

from __future__ import annotations

from pathlib import Path

import made_run
import numpy as np
from cases import Run, recorded
from made_run import answer, at_s, detected, frame, link, order, report, simspec, tape, tracks

from test_ports.ground_truth import FlownTrack


def test_a_made_run_survives_the_recording(tmp_path: Path) -> None:
    """Every stream of a made tape survives the recording."""
    spec = simspec()
    made = tape(
        spec,
        frames=(frame(0, 10.0, made_run.NEAR),),
        detections=(detected(10.0, "civilian"),),
        reports=(report(20.0, "mobile_radar", 100.0, 100.0, mark=True),),
        tracks=(tracks(21.0, ("civilian", 120.0, 100.0)),),
        orders=(order(30.0, "hold"),),
        answers=(answer(31.0, "hold"),),
        operator_link=link((0.0, True), (40.0, False)),
    )
    back = recorded(Run(spec, made), tmp_path / "recording.mcap")
    for name in (
        "cast",
        "frames",
        "detections",
        "condition",
        "reports",
        "tracks",
        "orders",
        "answers",
        "operator_link",
    ):
        assert getattr(back, name) == getattr(made, name), name
    np.testing.assert_allclose(back.vehicle_position_enu_m, made.vehicle_position_enu_m)
    np.testing.assert_allclose(back.actor_position_enu_m, made.actor_position_enu_m)


def test_velocity_and_tilt_survive_the_recording(tmp_path: Path) -> None:
    """The twist is written in the body's axes and read back in the map's."""
    spec = simspec()
    made = tape(spec, end_s=5.0)
    made.vehicle_velocity_enu_mps[:] = (3.0, -2.0, 1.0)
    tilted = made_run.tape(spec, end_s=5.0, vehicle_tilt_rad=np.full(len(made.vehicle_time_s), 0.4))
    tilted.vehicle_velocity_enu_mps[:] = (3.0, -2.0, 1.0)
    back = recorded(Run(spec, tilted), tmp_path / "recording.mcap")
    np.testing.assert_allclose(back.vehicle_velocity_enu_mps, tilted.vehicle_velocity_enu_mps, atol=1e-9)
    np.testing.assert_allclose(back.vehicle_tilt_rad, 0.4, atol=1e-9)


def test_flight_of_a_made_run() -> None:
    """In the air from 5 s until 5 s before the end; distances follow people who walk."""
    spec = simspec()
    made = tape(spec, end_s=100.0)
    made.actor_position_enu_m[:, made_run.FAR, 0] = made.actor_time_s  # walks east at 1 m/s
    flight = FlownTrack(made, spec)
    assert flight.time_s[flight.airborne][[0, -1]].tolist() == [5.0, 94.5]
    row = int(np.searchsorted(flight.time_s, 50.0))
    apart = flight.distance_m([made_run.FAR])[row, 0]
    east, north = flight.place_m[row]
    assert apart == np.hypot(50.0 - east, -200.0 - north)
    assert flight.above_m([made_run.FAR])[row, 0] == 60.0
    assert flight.time_share(flight.up_m > 0.0, flight.airborne) == 1.0
    assert flight.time_share(flight.up_m > 0.0, flight.between(200.0, 300.0)) is None


def test_no_flight_after_a_crash() -> None:
    """The time after a crash is not time in the air."""
    spec = simspec()
    fallen = tape(
        spec,
        condition=(
            *made_run.conditions((0.0, True), (5.0, False)),
            *made_run.conditions((50.0, False), crashed=True),
        ),
    )
    assert FlownTrack(fallen, spec).time_s[FlownTrack(fallen, spec).airborne][-1] == 49.5
    assert at_s(1.0).ns == 1_000_000_000
