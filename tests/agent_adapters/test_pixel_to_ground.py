"""The geometry that every agent needs, in each language's client, against rotations and rays by SciPy on random poses."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from agent_adapters.client import Eye, Sighting, Thing, Things
from bench.streams import (
    BoundingBox2D,
    CameraInfo,
    Detection2D,
    Detection2DArray,
    Header,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    Point2D,
    Pose2D,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
    json_value,
)

TICK = Path(__file__).parents[2] / "examples" / "tick"
Message = tuple[str, Any]
CASES = 200


def quaternion(rotation: Rotation) -> Quaternion:
    x, y, z, w = rotation.as_quat().tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def transform(parent: str, child: str, at: Any, rotation: Rotation) -> TransformStamped:
    place = Vector3(x=float(at[0]), y=float(at[1]), z=float(at[2]))
    turned = Transform(translation=place, rotation=quaternion(rotation))
    return TransformStamped(header=Header(frame_id=parent), child_frame_id=child, transform=turned)


def detection(label: str, score: float, x: float, y: float, height: float) -> Detection2D:
    box = BoundingBox2D(center=Pose2D(position=Point2D(x=x, y=y)), size_x=4.0, size_y=height)
    best = ObjectHypothesis(class_id=label, score=score)
    return Detection2D(bbox=box, results=(ObjectHypothesisWithPose(hypothesis=best),))


def scene(seed: int) -> tuple[list[Message], list[Sighting]]:
    """Messages with one detection each, and where it stands by SciPy; among them rays that meet no ground."""
    random = np.random.default_rng(seed)
    mount = Rotation.random(random_state=seed)
    focal, centre = random.uniform(200, 900, 2), random.uniform(100, 900, 2)
    k = [focal[0], 0.0, centre[0], 0.0, focal[1], centre[1], 0.0, 0.0, 1.0]
    messages: list[Message] = [
        ("/tf_static", TFMessage(transforms=(transform("v/base_link", "v/optical", (0, 0, 0), mount),))),
        ("/v/camera/front/camera_info", CameraInfo(k=tuple(float(value) for value in k))),
    ]
    expected = []
    for number in range(CASES):
        at, body = (
            random.uniform((-300, -300, 5), (300, 300, 90)),
            Rotation.random(random_state=seed + number),
        )
        other = transform("map", "v/base_level", (0, 0, 1), Rotation.identity())
        messages.append(("/tf", TFMessage(transforms=(transform("map", "v/base_link", at, body), other))))
        x, y, height = random.uniform((0, 0, 1), (1000, 1000, 50)).tolist()
        score = float(random.uniform(0.1, 1.0))
        found = detection(f"class-{number % 3}", score, x, y, height)
        header = Header(frame_id="v/optical")
        messages.append(("/v/detections", Detection2DArray(header=header, detections=(found,))))
        camera = np.array([(x - centre[0]) / focal[0], (y + height / 2 - centre[1]) / focal[1], 1.0])
        ray = (body * mount).apply(camera)
        if ray[2] <= -0.05:
            east_m, north_m = (at[:2] - ray[:2] * at[2] / ray[2]).tolist()
            expected.append(Sighting(f"class-{number % 3}", score, east_m, north_m))
    assert CASES / 5 < len(expected) < CASES * 4 / 5
    return messages, expected


def check(found: list[list[Any]], expected: list[Sighting]) -> None:
    assert [item[0] for item in found] == [item.class_label for item in expected]
    numbers = [(item.confidence, item.east_m, item.north_m) for item in expected]
    np.testing.assert_allclose(np.array([item[1:] for item in found], float), numbers, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_in_the_client_for_agents_on_zenoh(seed: int) -> None:
    messages, expected = scene(seed)
    eye = Eye()
    assert eye.ground(1.0, 1.0) is None
    found = [item for topic, message in messages for item in eye.see(topic, message)]
    check([[item.class_label, item.confidence, item.east_m, item.north_m] for item in found], expected)


def test_things_are_the_means_of_what_is_near_and_of_one_class() -> None:
    things = Things()
    for time_s, sighting in enumerate(
        [
            Sighting("a", 0.5, 0.0, 0.0),
            Sighting("a", 0.9, 10.0, 0.0),
            Sighting("b", 0.5, 5.0, 0.0),
            Sighting("a", 0.4, 20.0, 0.0),
        ]
    ):
        things.take(sighting, time_s, within_m=15.0)
    assert things == [
        # 20 m is no nearer than 15 m to the mean of the first two.
        Thing("a-0", "a", 5.0, 0.0, 0.9, 2, 1),
        Thing("b-1", "b", 5.0, 0.0, 0.5, 1, 2),
        Thing("a-2", "a", 20.0, 0.0, 0.4, 1, 3),
    ]


C_PROGRAM = """
#include "rebar_air.h"
int main(void) {
  char *line = NULL;
  size_t size = 0;
  while (getline(&line, &size, stdin) > 0) {
    const json *item = json_read(line);
    air_thing seen[4];
    int count = air_see(json_text(item, "topic"), json_get(item, "message"), seen, 4);
    for (int i = 0; i < count; i++)
      printf("[\\"%s\\",%.17g,%.17g,%.17g]\\n", seen[i].class_label, seen[i].confidence, seen[i].place.east_m, seen[i].place.north_m);
  }
}
"""
RUST_PROGRAM = """
mod rebar_air;
fn main() {
    let mut eye = rebar_air::Eye::default();
    for line in std::io::stdin().lines() {
        let item = rebar_air::Json::read(&line.unwrap());
        for seen in eye.see(item.text("topic"), item.get("message")) {
            println!("[{:?},{},{},{}]", seen.class_label, seen.confidence, seen.place[0], seen.place[1]);
        }
    }
}
"""
NODE_PROGRAM = """
const { Eye } = require(process.argv[2]);
const eye = new Eye();
require("node:readline").createInterface({ input: process.stdin }).on("line", (line) => {
  const { topic, message } = JSON.parse(line);
  for (const seen of eye.see(topic, message))
    console.log(JSON.stringify([seen.class_label, seen.confidence, seen.east_m, seen.north_m]));
});
"""
PYTHON_PROGRAM = """
import json, sys
sys.path.insert(0, sys.argv[1])
from rebar_air import Eye
eye = Eye()
for line in sys.stdin:
    item = json.loads(line)
    for seen in eye.see(item["topic"], item["message"]):
        print(json.dumps(seen))
"""

ROS2_PROGRAM = """
import json, sys
from types import SimpleNamespace
sys.path.insert(0, sys.argv[1])
from drone import Eye
eye = Eye()
for line in sys.stdin:
    item = json.loads(line, object_hook=lambda fields: SimpleNamespace(**fields))
    if item.topic in ("/tf", "/tf_static"):
        eye.take_frames(item.message)
    elif item.topic.endswith("/camera_info"):
        eye.take_camera(item.message)
    elif item.topic.endswith("/detections"):
        for seen in eye.see(item.message):
            print(json.dumps(seen))
"""


def command_of(language: str, folder: Path) -> list[str]:
    """A program that reads messages as lines of JSON and writes what they show; skips without its language."""
    tools = {"python": sys.executable, "ros2": sys.executable, "node": "node", "c": "cc", "rust": "rustc"}
    if shutil.which(tools[language]) is None:
        pytest.skip(f"{tools[language]} is not installed")
    if language == "python":
        return [sys.executable, "-I", "-c", PYTHON_PROGRAM, str(TICK)]
    if language == "ros2":
        return [sys.executable, "-I", "-c", ROS2_PROGRAM, str(TICK.parent / "ros2")]
    if language == "node":
        (folder / "see.js").write_text(NODE_PROGRAM)
        return ["node", str(folder / "see.js"), str(TICK / "rebar_air.js")]
    program = str(folder / "see")
    if language == "c":
        (folder / "see.c").write_text(C_PROGRAM)
        flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-I", str(TICK)]
        subprocess.run(["cc", *flags, "-o", program, str(folder / "see.c"), "-lm"], check=True)
    else:
        shutil.copy(TICK / "rebar_air.rs", folder)
        (folder / "see.rs").write_text(RUST_PROGRAM)
        subprocess.run(["rustc", "--edition", "2021", "-o", program, str(folder / "see.rs")], check=True)
    return [program]


@pytest.mark.parametrize("language", ["python", "node", "c", "rust", "ros2"])
def test_in_the_clients_for_agents_without_a_library(language: str, tmp_path: Path) -> None:
    """As JSON, with white space, escapes and letters of other alphabets in what they need not understand."""
    messages, expected = scene(3)
    noise = {
        "note": 'a "quoted" \\ line\n\u00e9\u4e2d\U0001f681',
        "nothing": None,
        "yes": True,
        "list": [[], {}, -1.5e-3],
    }
    lines = [
        json.dumps(
            {"noise": noise, "topic": topic, "message": json_value(message) | {"noise": noise}},
            ensure_ascii=number % 2 == 0,
        )
        for number, (topic, message) in enumerate(messages)
    ]
    command = command_of(language, tmp_path)
    done = subprocess.run(
        command, input="\n".join(lines) + "\n", capture_output=True, encoding="utf-8", check=True
    )
    check([json.loads(line) for line in done.stdout.splitlines()], expected)
