"""What a mission does with what the vehicle carries: its gimbal and its camera."""

from __future__ import annotations

import math

from ..payload._camera import CameraComponent
from ..payload._gimbal import KNOWN_FLAGS, NEUTRAL, Gimbal
from ._store import Item

MOUNT_CONTROL, PITCH_YAW = 205, 1000
START_CAPTURE, STOP_CAPTURE, DIGICAM_CONTROL, TRIGGER_DISTANCE = 2000, 2001, 203, 206
_NEUTRAL_MODE = 1.0  # MAV_MOUNT_MODE


def use_payload(gimbal: Gimbal | None, camera: CameraComponent | None, item: Item) -> None:
    """Carry out an item for the gimbal or the camera where the vehicle has it; any other is passed over.

    A mission turns the gimbal whoever is in control of it.
    """
    if gimbal:
        _turn(gimbal, item)
    if camera:
        _take(camera, item)


def _turn(gimbal: Gimbal, item: Item) -> None:
    if item.command == PITCH_YAW:
        flags = item.x if 0 <= item.x <= KNOWN_FLAGS else 0
        pitch, yaw, pitch_rate, yaw_rate = (math.radians(one) for one in item.params)
        gimbal.turn(flags, pitch, yaw, pitch_rate, yaw_rate)
    elif item.command == MOUNT_CONTROL:
        pitch, _, yaw, _ = (math.radians(one) for one in item.params)
        gimbal.turn(NEUTRAL if item.z == _NEUTRAL_MODE else 0, pitch, yaw, math.nan, math.nan)


def _take(camera: CameraComponent, item: Item) -> None:
    first, second, third, fourth = item.params
    if item.command == START_CAPTURE:
        camera.start(second, third, fourth)
    elif item.command == STOP_CAPTURE:
        camera.stop()
    elif item.command == DIGICAM_CONTROL and item.x:  # its fifth parameter: shoot
        camera.shoot()
    elif item.command == TRIGGER_DISTANCE:
        camera.every(first)
        if third == 1.0:
            camera.shoot()
