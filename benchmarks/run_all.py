"""Every benchmark in its short form, one after the other, and one table of their figures: `make bench`.

The figures are for comparing two versions on one machine within the hour; the pages of docs/ say what the long forms gave.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
COLUMNS = r"^(.+?) {2,}([\d.]+)\b"

SHORT_FORMS: dict[str, tuple[list[str], str, str]] = {
    "vehicle_speed": (["20"], COLUMNS, "simulated s for a CPU s"),
    "session_speed": (["20"], COLUMNS, "simulated s for a CPU s"),
    "warp_speed": (["--sessions", "2"], r"^(median).*: ([\d.]+),", "simulated s for a s of the clock"),
    "overhead_speed": (["--rounds", "1"], r'^ "(.+)": (\d+)', "missions for a CPU s"),
    "placement_speed": (["72"], r"^(.+?) +([\d.]+) ms  ", "ms of CPU, mean"),
    "camera_speed": (["opencv", "2"], r"^  (.+?) +([\d.]+) ms", "ms of CPU a frame"),
    "scoring_speed": (["1000"], r"^(.+?) +([\d.]+) s CPU", "s of CPU, 1000 runs"),
    "interval_coverage": (["100"], r"^(\d+ cells), mean ([\d.]+) %", "% covered, of 95"),
}
"""By file: its arguments, a pattern of its lines (what, value), and the unit of the values."""


def main() -> int:
    """Print the table row by row; 1 when a benchmark failed or printed no figure."""
    failed = False
    print("| benchmark | what | value | unit |\n| --- | --- | ---: | --- |")
    for name, (arguments, pattern, unit) in SHORT_FORMS.items():
        command = [sys.executable, str(FOLDER / f"{name}.py"), *arguments]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
        figures = re.findall(pattern, done.stdout, re.MULTILINE)
        failed |= bool(done.returncode) or not figures
        for what, value in figures:
            print(f"| {name} | {what.strip()} | {value} | {unit} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
