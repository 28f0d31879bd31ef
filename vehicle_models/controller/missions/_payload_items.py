"""Mission items for the gimbal and the camera."""

from __future__ import annotations

import math

from ..links._enums import MAV_CMD, MAV_MOUNT_MODE
from ..payload._camera import CameraComponent
from ..payload._gimbal import KNOWN_FLAGS, NEUTRAL, Gimbal
from ..state._plan_store import MissionItem

PAYLOAD_ITEMS: dict[int, str] = {
    MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW: "carried out with a gimbal",
    MAV_CMD.DO_MOUNT_CONTROL: "carried out with a gimbal",
    MAV_CMD.IMAGE_START_CAPTURE: "carried out with a camera",
    MAV_CMD.IMAGE_STOP_CAPTURE: "carried out with a camera",
    MAV_CMD.DO_DIGICAM_CONTROL: "carried out with a camera",
    MAV_CMD.DO_SET_CAM_TRIGG_DIST: "carried out with a camera",
}
"""What each of these items does, in words of docs/flight-controller.md."""


def use_payload(gimbal: Gimbal | None, camera: CameraComponent | None, item: MissionItem) -> None:
    """Carry out an item for the gimbal or the camera where the vehicle has it; ignore any other.

    A mission turns the gimbal regardless of who has control of it.
    """
    if gimbal:
        _turn_gimbal(gimbal, item)
    if camera:
        _command_camera(camera, item)


def _turn_gimbal(gimbal: Gimbal, item: MissionItem) -> None:
    if item.command == MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW:
        flags = item.x if 0 <= item.x <= KNOWN_FLAGS else 0
        pitch, yaw, pitch_rate, yaw_rate = (math.radians(angle) for angle in item.params)
        gimbal.turn(flags, pitch, yaw, pitch_rate, yaw_rate)
    elif item.command == MAV_CMD.DO_MOUNT_CONTROL:
        pitch, _, yaw, _ = (math.radians(angle) for angle in item.params)
        gimbal.turn(NEUTRAL if item.z == MAV_MOUNT_MODE.NEUTRAL else 0, pitch, yaw, math.nan, math.nan)


def _command_camera(camera: CameraComponent, item: MissionItem) -> None:
    first, second, third, fourth = item.params
    if item.command == MAV_CMD.IMAGE_START_CAPTURE:
        camera.start(second, third, fourth)
    elif item.command == MAV_CMD.IMAGE_STOP_CAPTURE:
        camera.stop()
    elif item.command == MAV_CMD.DO_DIGICAM_CONTROL and item.x:  # its fifth parameter: shoot
        camera.shoot()
    elif item.command == MAV_CMD.DO_SET_CAM_TRIGG_DIST:
        camera.every(first)
        if third == 1.0:
            camera.shoot()
