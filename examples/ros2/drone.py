"""What search_node.py flies and sees with: pymavlink for PX4 and ArduPilot, detections on flat ground."""

import math

import numpy as np
from pymavlink import mavutil

MAV = mavutil.mavlink
# A sighting is three clear detections of a class within 15 m; who walks is elsewhere after half a minute. Chosen.
SIGHTINGS, NEAR_M, SCORE, FORGET_S = 3, 15.0, 0.35, 30.0
METRES_PER_DEGREE = 111_194.9  # of latitude on the mean sphere; a search asks for no more


class Vehicle:
    """The autopilot behind REBAR_MAVLINK: `ready` to arm, `armed`, `ground_m` (above sea level, as it measures it)."""

    def __init__(self, address):
        self._link = mavutil.mavlink_connection(address, source_system=246)
        self.ready = self.armed = self._ardupilot = False
        self.ground_m = None

    def receive(self):
        while message := self._link.recv_match(blocking=False):
            kind = message.get_type()
            if kind == "HEARTBEAT" and message.autopilot != MAV.MAV_AUTOPILOT_INVALID:
                self._ardupilot = message.autopilot == MAV.MAV_AUTOPILOT_ARDUPILOTMEGA
                self.armed = bool(message.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED)
            elif kind == "SYS_STATUS":
                self.ready = bool(message.onboard_control_sensors_health & MAV.MAV_SYS_STATUS_PREARM_CHECK)
            elif kind == "GLOBAL_POSITION_INT":
                self.ground_m = (message.alt - message.relative_alt) * 1e-3

    def heartbeat(self):
        """Once a second."""
        if not self._link.target_system:  # nothing has come from it yet
            return
        kind, autopilot, state = (
            MAV.MAV_TYPE_ONBOARD_CONTROLLER,
            MAV.MAV_AUTOPILOT_INVALID,
            MAV.MAV_STATE_ACTIVE,
        )
        self._link.mav.heartbeat_send(kind, autopilot, 0, 0, state)
        if self.ground_m is None:  # ArduPilot streams nothing of itself
            self._link.mav.request_data_stream_send(1, 1, MAV.MAV_DATA_STREAM_ALL, 5, 1)

    def arm(self):
        if self._ardupilot:
            self._link.set_mode("GUIDED")
        self._command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def take_off(self, height_m):
        here, to_m = (0.0, height_m) if self._ardupilot else (math.nan, self.ground_m + height_m)
        self._command(MAV.MAV_CMD_NAV_TAKEOFF, here, 0, 0, here, here, here, to_m)

    def go_to(self, origin, east_m, north_m, height_m, speed_mps):
        """The autopilot flies there by itself and stays."""
        of_longitude_m = METRES_PER_DEGREE * math.cos(math.radians(origin["latitude_deg"]))
        latitude_deg = origin["latitude_deg"] + north_m / METRES_PER_DEGREE
        longitude_deg = origin["longitude_deg"] + east_m / of_longitude_m
        place = round(latitude_deg * 1e7), round(longitude_deg * 1e7), self.ground_m + height_m
        how = speed_mps, MAV.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE, 0, math.nan
        frame, number = MAV.MAV_FRAME_GLOBAL, MAV.MAV_CMD_DO_REPOSITION
        self._link.mav.command_int_send(1, 1, frame, number, 0, 0, *how, *place)

    def land(self):
        self._command(MAV.MAV_CMD_NAV_LAND, 0, 0, 0, math.nan)

    def _command(self, number, *parameters):
        zeros = (0.0,) * (7 - len(parameters))
        self._link.mav.command_long_send(1, 1, number, 0, *parameters, *zeros)


class Eye:
    """Detections thrown onto flat ground, by the latest transforms from the camera to the map."""

    def __init__(self):
        self.frames, self._k = {}, None

    def take_frames(self, message):
        self.frames |= {item.child_frame_id: item for item in message.transforms}

    def take_camera(self, message):
        self._k = message.k

    def see(self, message):
        """The objects in a Detection2DArray: (class, score, east_m, north_m)."""
        for detection in message.detections if self._k is not None else ():
            best, middle = detection.results[0].hypothesis, detection.bbox.center.position
            # The middle of the lower edge stands on the ground.
            right = (middle.x - self._k[2]) / self._k[0]
            down = (middle.y + detection.bbox.size_y / 2 - self._k[5]) / self._k[4]
            place, ray, frame = np.zeros(3), np.array((right, down, 1.0)), message.header.frame_id
            while item := self.frames.get(frame):
                move, q, frame = item.transform.translation, item.transform.rotation, item.header.frame_id
                place, ray = _turned(q, place), _turned(q, ray)
                place += (move.x, move.y, move.z)
            if frame == "map" and ray[2] < -0.05:
                east_m, north_m, _ = (place - ray * place[2] / ray[2]).tolist()
                yield best.class_id, best.score, east_m, north_m


class Things:
    """What was seen where: sightings of a class near each other are one thing, at their mean."""

    def __init__(self):
        self._tracks, self._seen_s = [], {}

    def take(self, now_s, label, score, east_m, north_m):
        if score < SCORE:
            return
        new = {"id": f"{label}-{len(self._tracks)}", "class_label": label, "confidence": score, "frames": 0}
        new |= {"east_m": east_m, "north_m": north_m}
        alike = (track for track in self._tracks if track["class_label"] == label)
        track = next((track for track in alike if apart_m(track, new) < NEAR_M), new)
        if track is new:
            self._tracks.append(track)
        track["frames"] += 1
        for key in ("east_m", "north_m"):
            track[key] += (new[key] - track[key]) / track["frames"]
        track["confidence"] = max(track["confidence"], score)
        self._seen_s[track["id"]] = now_s

    def sure(self, now_s, walking):
        """Tracks that were seen often enough, and of `walking` classes not too long ago."""
        sure = (track for track in self._tracks if track["frames"] >= SIGHTINGS)
        old_s = now_s - FORGET_S
        return [
            track
            for track in sure
            if track["class_label"] not in walking or self._seen_s[track["id"]] > old_s
        ]

    def report(self, now_s, mission, target):
        """What to report of a target, if it was seen where it is said to be."""
        bystanders = mission["bystander_classes"]
        sure = self.sure(now_s, bystanders)
        alike = (track for track in sure if track["class_label"] == target["class_label"])
        near = (track for track in alike if apart_m(track, target) <= target["uncertainty_m"])
        if (track := next(near, None)) is None:
            return None
        people = (other for other in sure if other["class_label"] in bystanders)
        count = sum(apart_m(other, track) < mission["no_mark_within_m"] for other in people)
        stated = {key: track[key] for key in ("class_label", "east_m", "north_m", "confidence")}
        stated |= {"mark": count == 0, "bystanders_seen": count, "reason": f"{count} people are near"}
        return {"id": f"report-{target['id']}", "intelligence_id": target["id"], **stated}


def apart_m(thing, other):
    return math.dist((thing["east_m"], thing["north_m"]), (other["east_m"], other["north_m"]))


def _turned(q, vector):
    axis = np.array((q.x, q.y, q.z))
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + q.w * vector)
