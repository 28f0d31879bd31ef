"""Where the vehicle and its camera were at a moment, from the records of a recording."""

from __future__ import annotations

import math
from bisect import bisect_left

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from bench.contracts import TF, TRUTH_ODOMETRY, Record, SimTime, VehicleState
from bench.simspec import Camera, SimSpec
from bench.streams import Odometry, Quaternion, TFMessage, decode


class RecordedStates:
    """Takes in records in order of time; knows the state of the vehicle between the first and the last of them.

    The recording has ten states a second: between two of them positions are interpolated.
    """

    def __init__(self, simspec: SimSpec, camera: Camera) -> None:
        self._optical = f"{simspec.vehicle.name}/camera_{camera.name}_optical"
        self._gimbal = camera.gimbal
        self._odometry: list[tuple[int, Odometry]] = []
        self._mounts: list[tuple[int, Quaternion]] = []

    def take(self, record: Record) -> None:
        """Keep what a record says about the vehicle's motion."""
        if record.topic == TRUTH_ODOMETRY:
            odometry = decode(Odometry, record.data)
            if odometry is not None:
                self._odometry.append((record.time.ns, odometry))
        elif record.topic == TF and self._gimbal:
            message = decode(TFMessage, record.data)
            for transform in message.transforms if message is not None else ():
                if transform.child_frame_id == self._optical:
                    self._mounts.append((record.time.ns, transform.transform.rotation))

    def at(self, time: SimTime) -> VehicleState | None:
        """The state at a moment; None outside the recorded ones."""
        place = bisect_left(self._odometry, time.ns, key=lambda row: row[0])
        if place < len(self._odometry) and self._odometry[place][0] == time.ns:
            return self._state(time, self._odometry[place][1], self._odometry[place][1], 0.0)
        if not 0 < place < len(self._odometry):
            return None
        (before_ns, before), (after_ns, after) = self._odometry[place - 1 : place + 1]
        return self._state(time, before, after, (time.ns - before_ns) / (after_ns - before_ns))

    def _state(self, time: SimTime, before: Odometry, after: Odometry, share: float) -> VehicleState:
        """`share` of the way from one sample to the next."""
        samples = [_numbers(odometry) for odometry in (before, after)]
        position, twist, rates = (
            first + share * (second - first)
            for first, second in zip(samples[0][:3], samples[1][:3], strict=True)
        )
        turn = samples[0][3]
        if share > 0.0:
            turn = Slerp((0.0, 1.0), Rotation.concatenate([turn, samples[1][3]]))(share)
        # Yaw about up from east, pitch about left, roll about ahead; autopilots count yaw from north and pitch upwards.
        yaw, pitch, roll = turn.as_euler("ZYX").tolist()
        pan_rad, tilt_rad = self._gimbal_at(time)
        return VehicleState(
            time,
            (float(position[0]), float(position[1]), float(position[2])),
            tuple(turn.apply(twist).tolist()),
            roll,
            -pitch,
            math.pi / 2.0 - yaw,
            (float(rates[0]), -float(rates[1]), -float(rates[2])),
            pan_rad,
            tilt_rad,
        )

    def _gimbal_at(self, time: SimTime) -> tuple[float | None, float | None]:
        """Pan clockwise from the nose and tilt below the horizon, as of the last tick."""
        place = bisect_left(self._mounts, time.ns + 1, key=lambda row: row[0])
        if not place:
            return None, None
        turn = self._mounts[place - 1][1]
        mount = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w))
        # The optical axes in the carrier's: x ahead, y left, z up.
        right, ahead = mount.apply((1.0, 0.0, 0.0)), mount.apply((0.0, 0.0, 1.0))
        return math.atan2(-right[0], -right[1]), math.atan2(-ahead[2], math.hypot(ahead[0], ahead[1]))


def _numbers(odometry: Odometry) -> tuple[np.ndarray, np.ndarray, np.ndarray, Rotation]:
    place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
    return (
        np.array((place.x, place.y, place.z)),
        np.array((linear.x, linear.y, linear.z)),
        np.array((angular.x, angular.y, angular.z)),
        Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)),
    )
