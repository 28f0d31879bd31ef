"""What PX4's simulator link must keep, sample by sample."""

from __future__ import annotations

import math

from ._frames import require, unpacked
from ._pilot import State, Vector

# Bits of HIL_SENSOR.fields_updated: accelerometer and gyro, magnetometer, barometer and temperature.
SAMPLE_FIELDS = 0x3F, 0x1C0, 0x1A00


class SampleChecks:
    """What PX4's simulator link must keep, sample by sample."""

    def __init__(self, state: State, rate_hz: float) -> None:
        self.state, self.rate_hz = state, rate_hz
        self.time_us = 0
        self.step_us = 0
        self.gps_us: int | None = None
        self.imu: tuple[float, ...] = ()
        self.equal = 0
        self.field: Vector | None = None
        self.truth_us = -1
        self.start: tuple[float, float, float] | None = None

    def take_truth(self, payload: bytes) -> None:
        p = unpacked("<Q4f3fiii3hHH3h", payload)
        require(self.gps_us in (None, p[0]), "HIL_STATE_QUATERNION has another time than HIL_GPS before it")
        state = self.state
        require(abs(sum(v * v for v in p[1:5]) - 1.0) < 1e-3, f"quaternion {p[1:5]}")
        state.quaternion, state.rates = (p[1], p[2], p[3], p[4]), (p[5], p[6], p[7])
        state.latitude_deg, state.longitude_deg, state.altitude_m = p[8] * 1e-7, p[9] * 1e-7, p[10] * 1e-3
        state.velocity = (p[11] / 100, p[12] / 100, p[13] / 100)
        place = (state.latitude_deg, state.longitude_deg, state.altitude_m)
        self.start = self.start or place
        north = (place[0] - self.start[0]) * 111194.0
        east = (place[1] - self.start[1]) * 111194.0 * math.cos(math.radians(place[0]))
        state.position = (north, east, self.start[2] - place[2])
        self.truth_us = int(p[0])

    def take_gps(self, payload: bytes) -> None:
        p = unpacked("<QiiiHHHhhhHBBBH", payload)
        require(self.gps_us is None, "two HIL_GPS before one HIL_SENSOR")
        self.gps_us = int(p[0])
        require(10 <= p[4] <= 300 and 10 <= p[5] <= 500, f"eph {p[4]} and epv {p[5]} are no cm")
        require(p[11] == 3 and p[12] >= 10, f"fix type {p[11]} with {p[12]} satellites")
        require(p[10] < 36000 or p[10] == 65535, f"course {p[10]}")
        require(abs(p[6] - math.hypot(p[7], p[8])) < 2, "vel is not the length of vn, ve")
        if self.truth_us >= 0:
            state = self.state
            north = (p[1] * 1e-7 - state.latitude_deg) * 111194.0
            east = (p[2] * 1e-7 - state.longitude_deg) * 111194.0 * math.cos(math.radians(state.latitude_deg))
            require(
                math.hypot(north, east) < 30.0,
                f"HIL_GPS is {north:.1f} m north and {east:.1f} m east of the truth",
            )
            require(
                abs(p[3] / 1000 - state.altitude_m) < 5.0,
                f"HIL_GPS altitude {p[3]} mm at {state.altitude_m} m",
            )
            for reported, true in zip(p[7:10], state.velocity, strict=True):
                require(abs(reported / 100 - true) < 0.6, f"HIL_GPS velocity {reported} cm/s at {true} m/s")

    def take_sensor(self, payload: bytes, armed: bool) -> None:
        p = unpacked("<Q13fIB", payload)
        time_us, mask = int(p[0]), int(p[14])
        require(time_us > self.time_us, f"HIL_SENSOR time {time_us} after {self.time_us}")
        step_us = time_us - self.time_us
        require(self.step_us in (0, step_us), f"a step of {step_us} us after {self.step_us} us")
        require(step_us in (4000, 5000), f"a step of {step_us} us")
        self.step_us, self.time_us = step_us, time_us
        self.state.time_s = time_us / 1e6
        require(
            self.gps_us in (None, time_us), f"HIL_GPS of {self.gps_us} us before HIL_SENSOR of {time_us} us"
        )
        self.gps_us = None
        require(p[15] == 0, f"IMU {p[15]}")
        imu, magnetic, slow = SAMPLE_FIELDS
        require(mask & imu == imu, f"mask {mask:#x} lacks accelerometer or gyro")
        require(
            mask & ~(imu | magnetic | slow) == 0, f"mask {mask:#x} has bits of sensors that are not there"
        )
        require(
            mask & magnetic in (0, magnetic) and mask & slow in (0, slow),
            f"mask {mask:#x} has part of a group",
        )
        self._check_imu(p[1:7], armed)
        if mask & magnetic:
            self._check_magnetometer((p[7], p[8], p[9]))
        if mask & slow:
            require(300.0 < p[10] < 1100.0, f"pressure {p[10]} is no hPa")
            height_m = 44330.77 * (1 - (p[10] / 1013.25) ** 0.190263)
            require(
                self.truth_us < 0 or abs(height_m - self.state.altitude_m) < 4.0,
                f"pressure of {height_m:.1f} m",
            )
            require(-60.0 < p[13] < 60.0, f"temperature {p[13]}")
        if self.truth_us >= 0:
            require(self.truth_us == time_us, "asked for HIL_STATE_QUATERNION every 5 ms, one is missing")

    def _check_imu(self, imu: tuple[float, ...], armed: bool) -> None:
        require(all(map(math.isfinite, imu)), f"IMU {imu}")
        self.equal = self.equal + 1 if imu == self.imu else 0
        self.imu = imu
        require(self.equal < 5, "the IMU repeats itself: it has no noise")
        force: Vector = (imu[0], imu[1], imu[2])
        if self.truth_us < 0 and not armed:
            require(
                -10.5 < force[2] < -9.1, f"accelerometer z {force[2]} at rest: specific force is -9.81 there"
            )
        if self.truth_us >= 0:
            for rate, true in zip(imu[3:6], self.state.rates, strict=True):
                require(abs(rate - true) < 0.03, f"gyro {rate} rad/s at {true} rad/s")
            require(max(map(abs, force)) < 157.0, f"accelerometer {force}: more than 16 g")

    def _check_magnetometer(self, magnetic: Vector) -> None:
        strength = math.sqrt(sum(axis * axis for axis in magnetic))
        require(0.2 < strength < 0.7, f"a field of {strength}: not gauss")
        if self.truth_us >= 0:
            field = self.state.to_ned(magnetic)
            self.field = self.field or field
            apart = math.dist(field, self.field)
            require(apart < 0.03, f"the field turns with the body: {field} after {self.field}")
