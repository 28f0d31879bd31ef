"""Runs an rclpy program where ROS 2 is not installed: `on_pyzeros.py NODE.py` gives it what it imports, made of pyzeros.

Here are the parts of rclpy and the messages that search_node.py and offboard_node.py use; add what yours needs.
"""

import json
import os
import queue
import runpy
import struct
import sys
import time
from dataclasses import dataclass, field
from types import ModuleType, new_class

import zenoh
from pyzeros import Node as Connection
from pyzeros import Pub
from pyzeros.qos import DurabilityPolicy, QosProfile
from pyzeros.sub import RawSub
from ros2_pyterfaces.cyclone.geometry_msgs import msg as geometry_msgs
from ros2_pyterfaces.cyclone.idl import IdlStruct, types
from ros2_pyterfaces.cyclone.rosgraph_msgs import msg as rosgraph_msgs
from ros2_pyterfaces.cyclone.sensor_msgs import msg as sensor_msgs
from ros2_pyterfaces.cyclone.std_msgs import msg as std_msgs
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from bench.streams import PX4_FROM_AGENT, PX4_TO_AGENT, px4_message, schema_text

PX4_MSGS = "1.17"  # as in the manifest


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs/msg/TFMessage"):
    transforms: types.sequence[geometry_msgs.TransformStamped] = field(default_factory=list)


@dataclass
class Point2D(IdlStruct, typename="vision_msgs/msg/Point2D"):
    x: types.float64 = 0.0
    y: types.float64 = 0.0


@dataclass
class Pose2D(IdlStruct, typename="vision_msgs/msg/Pose2D"):
    position: Point2D = field(default_factory=Point2D)
    theta: types.float64 = 0.0


@dataclass
class BoundingBox2D(IdlStruct, typename="vision_msgs/msg/BoundingBox2D"):
    center: Pose2D = field(default_factory=Pose2D)
    size_x: types.float64 = 0.0
    size_y: types.float64 = 0.0


@dataclass
class ObjectHypothesis(IdlStruct, typename="vision_msgs/msg/ObjectHypothesis"):
    class_id: str = ""
    score: types.float64 = 0.0


@dataclass
class ObjectHypothesisWithPose(IdlStruct, typename="vision_msgs/msg/ObjectHypothesisWithPose"):
    hypothesis: ObjectHypothesis = field(default_factory=ObjectHypothesis)
    pose: geometry_msgs.PoseWithCovariance = field(default_factory=geometry_msgs.PoseWithCovariance)


@dataclass
class Detection2D(IdlStruct, typename="vision_msgs/msg/Detection2D"):
    header: std_msgs.Header = field(default_factory=std_msgs.Header)
    results: types.sequence[ObjectHypothesisWithPose] = field(default_factory=list)
    bbox: BoundingBox2D = field(default_factory=BoundingBox2D)
    id: str = ""


@dataclass
class Detection2DArray(IdlStruct, typename="vision_msgs/msg/Detection2DArray"):
    header: std_msgs.Header = field(default_factory=std_msgs.Header)
    detections: types.sequence[Detection2D] = field(default_factory=list)


def px4_class(name):
    """A class of px4_msgs, made of the bench's layouts; its hash is computed by pyzeros."""

    def fill(content):
        content["__annotations__"] = {}
        for line in schema_text(px4_message(name, PX4_MSGS)).splitlines():
            (base, _, count), key = line.split()[0].partition("["), line.split()[1]
            kind = bool if base == "bool" else getattr(types, base)
            zero = False if base == "bool" else 0.0 if base.startswith("float") else 0
            content[key] = zero
            if count:
                zeros = [zero] * int(count[:-1])
                kind, content[key] = types.array[kind, len(zeros)], field(default_factory=zeros.copy)
            content["__annotations__"][key] = kind

    return dataclass(new_class(name, (IdlStruct,), {"typename": f"px4_msgs/msg/{name}"}, fill))


def open_session():
    """A client of the bench's router. Shared memory is off: a box has no room for it."""
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [os.environ["REBAR_ZENOH"]]),
        ("transport/auth/usrpwd/user", os.environ["REBAR_ZENOH_USER"]),
        ("transport/auth/usrpwd/password", os.environ["REBAR_ZENOH_PASSWORD"]),
        ("transport/shared_memory/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Publisher(Pub):
    """pyzeros compiles its form of the attachment with Cython and a C compiler, 20 s in each session; this is the same bytes."""

    def publish(self, message):
        attachment = struct.pack("<qqB16s", self.count, time.time_ns(), 16, self.gid.tobytes())
        self.zenoh_pub.put(message.serialize(), attachment=attachment)
        self.count += 1


class Node:
    """rclpy's node, as far as it is needed: everything that is called back is called in `spin`."""

    def __init__(self, name):
        self._connection = Connection(name, session=open_session(), namespace="/")
        self._heard, self._timers, self._kept = queue.SimpleQueue(), [], []

    def create_publisher(self, kind, topic, qos):
        return Publisher(kind, topic, _profile(qos), session=self._connection)

    def create_subscription(self, kind, topic, callback, qos):
        def hear(sample):
            self._heard.put((kind, callback, sample.payload.to_bytes()))

        profile = _profile(qos)
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        # pyzeros has no latched topics: Zenoh's own subscriber asks for their history.
        subscription = RawSub(
            kind, topic, hear, None if latched else profile, self._connection, defer=latched
        )
        if latched:
            key, history = subscription.subscriber_keyexpr, HistoryConfig(detect_late_publishers=True)
            subscription = declare_advanced_subscriber(self._connection.session, key, hear, history=history)
        self._kept.append(subscription)

    def create_timer(self, period_s, callback):
        self._timers.append([time.monotonic() + period_s, period_s, callback])

    def spin(self):
        try:
            while True:
                self._spin_once()
        finally:
            self._connection.session.close()

    def _spin_once(self):
        next_s = min(due_s for due_s, _, _ in self._timers)
        try:
            kind, callback, data = self._heard.get(timeout=max(0.0, next_s - time.monotonic()))
        except queue.Empty:
            pass
        else:
            callback(kind.deserialize(data))
        for timer in self._timers:
            if timer[0] <= time.monotonic():
                timer[0] = time.monotonic() + timer[1]
                timer[2]()


def _profile(qos):
    return QosProfile(depth=qos) if isinstance(qos, int) else qos


def provide(name, **contents):
    """Make a module that can be imported."""
    sys.modules[name] = module = ModuleType(name)
    vars(module).update(contents)


def main():
    provide("rclpy", init=lambda: None, shutdown=lambda: None, spin=Node.spin)
    provide("rclpy.node", Node=Node)
    provide(
        "rclpy.qos",
        QoSProfile=QosProfile,
        DurabilityPolicy=DurabilityPolicy,
        qos_profile_sensor_data=QosProfile.sensor_data(),
    )
    for package in (geometry_msgs, rosgraph_msgs, sensor_msgs, std_msgs):
        name = package.__name__.split(".")[-2]
        provide(name)
        sys.modules[f"{name}.msg"] = package
    for name, kinds in (("tf2_msgs", [TFMessage]), ("vision_msgs", [Detection2D, Detection2DArray])):
        provide(name)
        provide(f"{name}.msg", **{kind.__name__: kind for kind in kinds})
    provide("px4_msgs")
    names = {*PX4_TO_AGENT.values(), *PX4_FROM_AGENT.values()}
    provide("px4_msgs.msg", **{name: px4_class(name) for name in names})
    sys.path.insert(0, os.path.dirname(os.path.abspath(sys.argv[1])))
    runpy.run_path(sys.argv[1], run_name="__main__")


if __name__ == "__main__":
    main()
