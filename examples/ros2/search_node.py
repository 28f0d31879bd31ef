"""A ROS 2 node that searches the reported places by urgency, reports what it sees there, and comes home; pymavlink flies."""

import json
import math
import os

import rclpy
from drone import Eye, Things, Vehicle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection2DArray

NAME = os.environ["REBAR_VEHICLE"]


class Search(Node):
    def __init__(self):
        super().__init__("search")
        self.eye, self.things, self.vehicle = Eye(), Things(), Vehicle(os.environ["REBAR_MAVLINK"])
        self.mission, self.targets = {}, []
        self.phase, self.arrived_s = "starting", None
        self.now_s = self.asked_s = self.told_s = 0.0
        names = ("status", "tracks", "reports", "answers")
        self.told = {name: self.create_publisher(String, f"/{NAME}/agent/{name}", 10) for name in names}
        latched = QoSProfile(depth=32, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for kind, topic, hear, qos in (
            (Clock, "/clock", self.hear_clock, qos_profile_sensor_data),
            (TFMessage, "/tf", self.eye.take_frames, 100),
            (TFMessage, "/tf_static", self.eye.take_frames, latched),
            (String, f"/{NAME}/mission", self.hear_mission, latched),
            (String, f"/{NAME}/intelligence", self.hear_intelligence, latched),
            (String, f"/{NAME}/orders", self.hear_order, latched),
            (CameraInfo, f"/{NAME}/camera/front/camera_info", self.eye.take_camera, qos_profile_sensor_data),
            (Detection2DArray, f"/{NAME}/detections", self.hear_detections, qos_profile_sensor_data),
        ):
            self.create_subscription(kind, topic, hear, qos)
        self.create_timer(0.05, self.step)

    def tell(self, name, **fields):
        self.told[name].publish(String(data=json.dumps({"time_s": self.now_s, **fields})))

    def hear_clock(self, message):
        self.now_s = message.clock.sec + message.clock.nanosec * 1e-9

    def hear_mission(self, message):
        self.mission = json.loads(message.data)

    def hear_intelligence(self, message):
        self.targets = sorted(
            [*self.targets, json.loads(message.data)], key=lambda target: target["priority"]
        )

    def hear_order(self, message):
        self.tell("answers", order=json.loads(message.data)["id"], accepted=False, reason="knows no orders")

    def hear_detections(self, message):
        for sighting in self.eye.see(message):
            self.things.take(self.now_s, *sighting)

    def step(self):
        self.vehicle.receive()
        if self.mission and self.now_s - self.told_s >= 1.0:
            self.told_s = self.now_s
            self.vehicle.heartbeat()
            self.tell("status", phase=self.phase)
            tracks = self.things.sure(self.now_s, self.mission["bystander_classes"])
            self.tell("tracks", tracks=tracks)
        own = self.eye.frames.get(f"{NAME}/base_link")
        if self.mission and own and self.vehicle.ground_m is not None:
            self.fly(own.transform.translation)

    def fly(self, own):
        vehicle, mission, phase = self.vehicle, self.mission, self.phase
        goal, height_m = (self.targets or [mission["home"]])[0], mission["altitude_m"]
        if phase == "starting" and vehicle.armed:
            self.phase = "taking_off"
        elif phase == "taking_off" and own.z > 0.8 * height_m:
            self.phase = "transit"
        elif phase in ("transit", "returning"):
            self.phase = "transit" if self.targets else "returning"
            # Over a place for eight seconds, or down at home.
            far = math.dist((own.x, own.y), (goal["east_m"], goal["north_m"])) > 5.0
            self.arrived_s = None if far else self.arrived_s or self.now_s
            if self.arrived_s and not self.targets:
                self.phase = "landing"
            elif self.arrived_s and self.now_s - self.arrived_s > 8.0:
                if report := self.things.report(self.now_s, mission, self.targets.pop(0)):
                    self.tell("reports", **report)
                self.arrived_s = None
        elif phase == "landing" and not vehicle.armed:
            self.phase = "complete"
        if self.now_s - self.asked_s >= 3.0:
            self.asked_s = self.now_s
            self.ask(goal, height_m)

    def ask(self, goal, height_m):
        if self.phase == "starting" and self.vehicle.ready:
            self.vehicle.arm()
        elif self.phase == "taking_off":
            self.vehicle.take_off(height_m)
        elif self.phase in ("transit", "returning"):
            place = goal["east_m"], goal["north_m"]
            self.vehicle.go_to(self.mission["origin"], *place, height_m, self.mission["speed_mps"])
        elif self.phase == "landing":
            self.vehicle.land()
        elif self.phase == "complete":
            raise SystemExit


def main():
    rclpy.init()
    rclpy.spin(Search())


if __name__ == "__main__":
    main()
