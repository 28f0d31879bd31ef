"""Payload: the camera and the gimbal, each with its MAVLink protocol."""
