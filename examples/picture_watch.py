"""An agent that receives the cameras' pictures, raw and as JPEG, and prints a line of JSON for each of them.

The lines are in agent.log of the session: topic, stamp, size, encoding, and the SHA-256 of the pixels (raw) or of the
file (JPEG). It does not fly. examples/picture_watch.yaml is its manifest; the option `cameras` names the cameras,
`front,down` for example.
"""

from __future__ import annotations

import hashlib
import json
import os

from agent_adapters.client import Wanted, open_bench, read_environment
from bench.streams import CompressedImage, Image, Sample


def described(sample: Sample) -> dict[str, object]:
    """What a picture is, without its pixels."""
    message = sample.message()
    stamp = message.header.stamp
    line = {
        "topic": sample.topic,
        "stamp_ns": stamp.sec * 1_000_000_000 + stamp.nanosec,
        "frame": message.header.frame_id,
        "sha256": hashlib.sha256(message.data).hexdigest(),
        "bytes": len(message.data),
    }
    if isinstance(message, Image):
        # A row may be padded: step says how many bytes it has.
        assert len(message.data) == message.height * message.step
        return {**line, "width": message.width, "height": message.height, "encoding": message.encoding}
    return {**line, "format": message.format}


def main() -> None:
    """Receive until the bench ends the session."""
    environment = read_environment(os.environ)
    cameras = str(environment.options.get("cameras", "front")).split(",")
    topics = [f"/{environment.vehicle}/camera/{camera}/image_raw" for camera in cameras]
    wanted = (
        *(Wanted(topic, Image) for topic in topics),
        *(Wanted(f"{topic}/compressed", CompressedImage) for topic in topics),
    )
    with open_bench("picture_watch", environment, wanted) as bench:
        for moment in bench.moments("picture-watch"):
            for sample in moment.samples:
                print(json.dumps(described(sample)))


if __name__ == "__main__":
    main()
