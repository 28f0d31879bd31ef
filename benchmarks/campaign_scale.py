"""What a large campaign costs beside its flights: `python benchmarks/campaign_scale.py [REALIZATIONS] [--folder DIR]`.

Surrogates fly scenes of five actors (fidelity overhead), so that nearly all of the time is the campaign's own. Prints wall time, CPU
time and peak memory of each command, of its largest process, and the bytes of the folder.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
FACTORS, ACTORS = {"fog", "concealment"}, {"radar", "truck", "neighbours"}
"""Of the demo: four situations of five actors each, so that little of the time is placement. Two agents fly each."""
SITUATIONS = 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("realizations", nargs="?", type=int, default=20_000)
    parser.add_argument("--folder", type=Path, help="kept, and resumed if it is there")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        campaign = write_campaign(folder, arguments.realizations)
        out = folder / "out"
        steps = {
            "fly": ["run", campaign, "--out", out],
            "list": ["status", out],
            "resume, nothing left": ["run", campaign, "--out", out],
            "report": ["report", out],
            "verify": ["verify", out],
        }
        print(f"{arguments.realizations} realizations")
        for name, words in steps.items():
            code, wall_s, cpu_s, peak_mb = measure(list(map(str, words)))
            print(
                f"{name:22} exit {code}  {wall_s:7.1f} s  {cpu_s:7.1f} CPU s  {peak_mb:6.0f} MB", flush=True
            )
        for part, (files, size) in sizes(out).items():
            print(
                f"{part:22} {files:7} files  {size / 1e6:8.1f} MB  {size / arguments.realizations:8.0f} bytes each"
            )


def write_campaign(folder: Path, realizations: int) -> Path:
    """Situations of the demo with so many replicates, at the fidelity overhead."""
    demo = yaml.safe_load((ROOT / "campaigns" / "demo.yaml").read_text())
    demo |= {"name": "scale", "fidelity": "overhead"}
    design, base = demo["design"], demo["base"]
    design["replicates"] = realizations // (SITUATIONS * len(demo["agents"]))
    design["method"] = {"kind": "full_factorial"}
    design["factors"] = [factor for factor in design["factors"] if factor["name"] in FACTORS]
    base["actors"] = [group for group in base["actors"] if group["id"] in ACTORS]
    path = folder / "scale.yaml"
    path.write_text(yaml.safe_dump(demo))
    return path


def measure(words: list[str]) -> tuple[int, float, float, float]:
    """Exit code, wall seconds, CPU seconds and peak megabytes of a command of rebar."""
    begin_s = time.monotonic()
    pid = os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "bench.cli", *words],
        os.environ,
        file_actions=[(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_WRONLY, 0) for number in (1, 2)],
    )
    _, status, usage = os.wait4(pid, 0)
    wall_s = time.monotonic() - begin_s
    return os.waitstatus_to_exitcode(status), wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def sizes(out: Path) -> dict[str, tuple[int, int]]:
    """Files and bytes by the first part of their path."""
    parts: dict[str, tuple[int, int]] = {}
    for path in out.rglob("*"):
        if path.is_file():
            name = path.relative_to(out).parts[0]
            files, size = parts.get(name, (0, 0))
            parts[name] = (files + 1, size + path.stat().st_size)
    return parts


if __name__ == "__main__":
    main()
