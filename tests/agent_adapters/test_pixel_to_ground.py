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
from bench import streams

TICK = Path(__file__).parents[2] / "examples" / "tick"
Message = tuple[str, Any]
CASES = 200


def quaternion(rotation: Rotation) -> streams.Quaternion:
    x, y, z, w = rotation.as_quat().tolist()
    return streams.Quaternion(x=x, y=y, z=z, w=w)


def transform(parent: str, child: str, at: Any, rotation: Rotation) -> streams.TransformStamped:
    place = streams.Vector3(x=float(at[0]), y=float(at[1]), z=float(at[2]))
    turned = streams.Transform(translation=place, rotation=quaternion(rotation))
    return streams.TransformStamped(
        header=streams.Header(frame_id=parent), child_frame_id=child, transform=turned
    )


def detection(label: str, score: float, x: float, y: float, height: float) -> streams.Detection2D:
    box = streams.BoundingBox2D(
        center=streams.Pose2D(position=streams.Point2D(x=x, y=y)), size_x=4.0, size_y=height
    )
    best = streams.ObjectHypothesis(class_id=label, score=score)
    return streams.Detection2D(bbox=box, results=(streams.ObjectHypothesisWithPose(hypothesis=best),))


def scene(seed: int) -> tuple[list[Message], list[Sighting]]:
    """Messages with one detection each, and where it stands by SciPy; among them rays that meet no ground."""
    random = np.random.default_rng(seed)
    mount = Rotation.random(random_state=seed)
    focal, centre = random.uniform(200, 900, 2), random.uniform(100, 900, 2)
    k = [focal[0], 0.0, centre[0], 0.0, focal[1], centre[1], 0.0, 0.0, 1.0]
    messages: list[Message] = [
        (
            "/tf_static",
            streams.TFMessage(transforms=(transform("v/base_link", "v/optical", (0, 0, 0), mount),)),
        ),
        ("/v/camera/front/camera_info", streams.CameraInfo(k=tuple(float(value) for value in k))),
    ]
    expected = []
    for number in range(CASES):
        at = random.uniform((-300, -300, 5), (300, 300, 90))
        body = Rotation.random(random_state=seed + number)
        other = transform("map", "v/base_level", (0, 0, 1), Rotation.identity())
        messages.append(
            ("/tf", streams.TFMessage(transforms=(transform("map", "v/base_link", at, body), other)))
        )
        x, y, height = random.uniform((0, 0, 1), (1000, 1000, 50)).tolist()
        score = float(random.uniform(0.1, 1.0))
        found = detection(f"class-{number % 3}", score, x, y, height)
        header = streams.Header(frame_id="v/optical")
        messages.append(("/v/detections", streams.Detection2DArray(header=header, detections=(found,))))
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
    seen = [("a", 0.5, 0.0), ("a", 0.9, 10.0), ("b", 0.5, 5.0), ("a", 0.4, 20.0)]
    for time_s, (label, confidence, east_m) in enumerate(seen):
        things.take(Sighting(label, confidence, east_m, 0.0), time_s, within_m=15.0)
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
    odd = 'a "quoted" \\ line\n\u00e9\u4e2d\U0001f681'
    noise = {"note": odd, "nothing": None, "yes": True, "list": [[], {}, -1.5e-3]}
    lines = []
    for number, (topic, message) in enumerate(messages):
        item = {"noise": noise, "topic": topic, "message": streams.json_value(message) | {"noise": noise}}
        lines.append(json.dumps(item, ensure_ascii=number % 2 == 0))
    command = command_of(language, tmp_path)
    text = "\n".join(lines) + "\n"
    done = subprocess.run(command, input=text, capture_output=True, encoding="utf-8", check=True)
    check([json.loads(line) for line in done.stdout.splitlines()], expected)
