"""The sensor messages of one moment for PX4, wherever it runs."""

from __future__ import annotations

from bench.simspec import SimSpec, generator

from ._body import Body
from ._hil import HilEncoder
from ._sensors import Sensors, magnetic_field_ned_gauss

# Of magnetometer and barometer.
_SLOW_HZ = 50


class Px4Samples:
    """Makes samples of a body, one after the other."""

    def __init__(self, simspec: SimSpec, body: Body) -> None:
        self._body = body
        origin = simspec.world.origin
        field = magnetic_field_ned_gauss(
            origin.latitude_deg, origin.longitude_deg, origin.altitude_m, simspec.environment.start_utc
        )
        # A stream of its own beside that of the receiver's error: neither depends on the rate of the other.
        self._sensors = Sensors(field, generator(simspec.seeds, "sensors", 1))
        self._encoder = HilEncoder()
        self._samples = 0
        self._slow_every = body.samples_hz // _SLOW_HZ
        self._sample_us = 1_000_000 // body.samples_hz
        self._next_truth_us = 0

    def advance(self) -> int:
        """Make one step of the physics. Returns its time in microseconds, counted from the first."""
        self._body.plant.advance()
        self._samples += 1
        return self._samples * self._sample_us

    def messages(self, time_us: int, *, new_fix: bool, truth_interval_us: int | None = None) -> list[bytes]:
        """HIL_GPS where there is a new fix, HIL_STATE_QUATERNION at the interval that PX4 asked for, and HIL_SENSOR last:
        in simulation it moves PX4's clock, and what follows would race with it.
        """
        body, sensors = self._body, self._sensors
        force = body.plant.specific_force_mps2()
        attitude = body.attitude()
        imu = sensors.read_imu(force, body.rates_radps())
        frames: list[bytes] = []
        if new_fix:
            frames.append(self._encoder.gps(time_us, body.fix()))
        if truth_interval_us is not None and time_us >= self._next_truth_us:
            self._next_truth_us = time_us + max(truth_interval_us, self._sample_us)
            airspeed_mps = body.plant.motion.airspeed_mps
            frames.append(
                self._encoder.state(time_us, attitude, body.rates_radps(), body.place(), airspeed_mps, force)
            )
        if self._samples % self._slow_every:
            return [*frames, self._encoder.sensor(time_us, imu)]
        magnetometer = sensors.read_magnetometer(attitude)
        air = sensors.read_barometer(body.altitude_m())
        return [*frames, self._encoder.sensor(time_us, imu, magnetometer, air)]
