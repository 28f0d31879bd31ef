"""MAVProxy on ArduPilot, typed at: python mavproxy_flight.py tcp:127.0.0.1:5760 CHAPTER...

Types `arm`, `takeoff`, `mode`, `guided`, `velocity`, `param show`, `param set`, `wp load`, `wp list`, `wp clear`,
`fence enable`, `fence list`, `rally list`, `status`, DO_MOUNT_CONTROL.
Is refused: arming during the start, disarming in the air, an unknown mode and parameter, an unknown item.
"""

from __future__ import annotations

import math
import queue
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from logbook import PATIENCE_S, apart, distance_m, place, run_chapters, wait_until

HOME = (47.3977, 8.5456)
MODULES = "log,wp,rally,fence,param,arm,mode,cmdlong,misc,rc,link,ftp"


class Console:
    """MAVProxy's terminal."""

    def __init__(self, url: str) -> None:
        program = Path(sys.executable).parent / "mavproxy.py"
        self.process = subprocess.Popen(
            [sys.executable, "-u", str(program), "--master", url, "--no-state", "--default-modules", MODULES],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1,
        )  # fmt: skip
        self.lines: queue.Queue[str] = queue.Queue()
        self.detected = threading.Event()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.put(line.rstrip())
            if "Detected vehicle" in line:
                self.detected.set()

    def type(self, line: str) -> None:
        assert self.process.stdin
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def expect(self, pattern: str, timeout_s: float = 30.0) -> re.Match[str]:
        """The first line from here on that the pattern is found in."""
        end = time.monotonic() + timeout_s
        output = []
        while (remaining := end - time.monotonic()) > 0:
            try:
                output.append(self.lines.get(timeout=remaining))
            except queue.Empty:
                break
            if match := re.search(pattern, output[-1]):
                return match
        return sys.exit(f"gave up waiting {timeout_s:.0f} s for {pattern!r}; heard {output}")

    def ask(self, line: str, pattern: str) -> str:
        """Type a line; what the pattern's first group, or all of it, found after it."""
        self.type(line)
        match = self.expect(pattern)
        return match.group(match.re.groups and 1)

    def close(self) -> None:
        self.process.kill()  # asked to end, it waits for its terminal
        self.process.wait()


class Flight:
    def __init__(self, console: Console, folder: Path) -> None:
        self.console = console
        self.folder = folder

    def here(self) -> tuple[float, float]:
        self.console.type("status GLOBAL_POSITION_INT")
        match = self.console.expect(r"GLOBAL_POSITION_INT \{.*lat : (-?\d+), lon : (-?\d+)")
        return int(match[1]) / 1e7, int(match[2]) / 1e7

    def height_m(self) -> float:
        return int(self.console.ask("status GLOBAL_POSITION_INT", r"relative_alt : (-?\d+)")) / 1000

    def until_height(self, low_m: float) -> None:
        end = time.monotonic() + PATIENCE_S
        while self.height_m() < low_m:
            if time.monotonic() > end:
                sys.exit(f"never reached {low_m} m")
            time.sleep(0.1)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once arming is granted in GUIDED; armed."""
        # Until MAVProxy knows the vehicle it takes the numbers of modes from a plane's table: GUIDED is AUTOTUNE then.
        if not self.console.detected.wait(PATIENCE_S):
            sys.exit("no vehicle was detected")
        self.console.ask("mode guided", r"Mode GUIDED|GUIDED>")
        # Before it is armed: idle on the ground it is disarmed after 10 simulated seconds.
        start = self.here()
        end = time.monotonic() + PATIENCE_S
        while self.console.ask("arm throttle", r"COMPONENT_ARM_DISARM: (\w+)") != "ACCEPTED":
            if time.monotonic() > end:
                sys.exit("never armed")
            time.sleep(0.5)
        return start

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.console.ask("takeoff 8", r"NAV_TAKEOFF: ACCEPTED")
        self.until_height(7.5)
        return start

    def down(self, start: tuple[float, float]) -> float:
        # At the pace of real time the way home from 17 m and a height of 15 m takes more than the usual 30 s.
        self.console.expect(r"^DISARMED", PATIENCE_S)
        return distance_m(start, self.here())

    def early(self) -> dict[str, Any]:
        """Detected, told its parameters, and not armed during another start."""
        detected = self.console.expect(r"Detected vehicle (\S+)").group(1)
        received = self.console.expect(r"Received (\d+) parameters").group(1)
        self.console.ask("reboot", r"PREFLIGHT_REBOOT_SHUTDOWN: ACCEPTED")
        arm = self.console.ask("arm throttle", r"COMPONENT_ARM_DISARM: (\w+)")
        return {"detected": detected, "arm": arm, "parameters": int(received)}

    def return_height(self) -> float:
        """RTL_ALT in centimetres, as the console knows it."""
        return float(self.console.ask("param show RTL_ALT", r"RTL_ALT\s+([\d.]+)"))

    def parameters(self) -> dict[str, Any]:
        before = self.return_height()
        self.console.type("param set RTL_ALT 1000")
        # `param show` prints what the autopilot last answered, so it shows when the answer is there.
        after = wait_until("another RTL_ALT", lambda: (value := self.return_height()) != before and value)
        self.console.type(f"param set RTL_ALT {before}")
        unknown = self.console.ask("param set NO_SUCH_PARAM 1", r"Unable to find parameter")
        return {"before": before, "after": after, "unknown": unknown}

    def logs(self) -> dict[str, Any]:
        """List the logs: there are none."""
        return {"listed": self.console.ask("log list", r"(No logs)")}

    def hop(self) -> dict[str, Any]:
        start = self.up()
        refused = self.console.ask("disarm", r"COMPONENT_ARM_DISARM: (\w+)")
        no_mode = self.console.ask("mode 99", r"(No such mode 99|Unknown mode)")
        status = self.console.ask("status SYS_STATUS", r"SYS_STATUS \{.*voltage_battery : (\d+)")
        self.console.ask("mode land", r"Mode LAND")
        return {
            "disarm_in_air": refused,
            "no_mode": no_mode,
            "voltage_mv": int(status),
            "from_start_m": self.down(start),
        }

    def travel(self) -> dict[str, Any]:
        start = self.up()
        target = place(*start, 14.0, -10.0)
        self.console.type(f"guided {target[0]:.7f} {target[1]:.7f} 8")
        end = time.monotonic() + PATIENCE_S
        while distance_m(self.here(), target) > 1.0:
            if time.monotonic() > end:
                sys.exit("never reached the place")
            time.sleep(0.1)
        reached = apart(start, self.here())
        self.console.ask("mode rtl", r"Mode RTL")
        return {"reached": reached, "from_start_m": self.down(start)}

    def setpoints(self) -> dict[str, Any]:
        """`velocity` and `position`, as MAVProxy types them: north, east, down."""
        start = self.up()
        end = time.monotonic() + PATIENCE_S
        while apart(start, self.here())[0] < 6.0:
            self.console.type("velocity 2 0 0")
            if time.monotonic() > end:
                sys.exit("velocity leads nowhere")
            time.sleep(0.1)
        north = apart(start, self.here())
        self.console.ask("mode rtl", r"Mode RTL")
        return {"moved": north, "from_start_m": self.down(start)}

    def write_plan(self, *rows: str) -> Path:
        lines = [f"0 0 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 488 1", *rows]
        text = [
            "QGC WPL 110",
            *("\t".join([str(number), *line.split()[1:]]) for number, line in enumerate(lines)),
        ]
        path = self.folder / "plan.txt"
        path.write_text("\n".join(text) + "\n")
        return path

    def plan(self) -> dict[str, Any]:
        """`wp load`, `wp list`, AUTO through a speed to the return, `wp clear`, and one that is refused."""
        first, second = place(*HOME, 18.0, 0.0), place(*HOME, 18.0, 20.0)
        bad = self.write_plan("1 0 3 31999 0 0 0 0 0 0 10 1")
        refused = self.console.ask(f"wp load {bad}", r"TYPE_MISSION: (\w+)")
        path = self.write_plan(
            "1 0 3 22 0 0 0 0 0 0 8 1",
            "2 0 3 178 1 4 0 0 0 0 0 1",
            f"3 0 3 16 0 0 0 0 {first[0]} {first[1]} 8 1",
            f"4 0 3 16 0 0 0 0 {second[0]} {second[1]} 8 1",
            "5 0 3 20 0 0 0 0 0 0 0 1",
        )
        loaded = self.console.ask(f"wp load {path}", r"TYPE_MISSION: (\w+)")
        listed = self.console.ask("wp list", r"Requesting (\d+) waypoints")
        start = self.ready()
        # The console shows the mode seconds later while it takes in parameters.
        self.console.ask("mode auto", r"DO_SET_MODE: ACCEPTED")
        self.console.type("long MISSION_START 0 0")
        reached = [self.console.expect(rf"Reached command #({number})").group(1) for number in (3, 4)]
        from_start_m = self.down(start)
        self.console.type("wp clear")
        self.console.expect(r"TYPE_MISSION: ACCEPTED|Cleared")
        remaining = self.console.ask("wp list", r"Requesting (\d+) waypoints")
        return {
            "refused": refused, "loaded": loaded, "listed": int(listed), "reached": reached, "from_start_m": from_start_m,
            "left": int(remaining),
        }  # fmt: skip

    def fence(self) -> dict[str, Any]:
        """FENCE_* and `fence enable`, broken by a velocity; fence and rally points are listed."""
        points = self.console.ask("fence list", r"Requesting (\d+) fence items")
        rally = self.console.ask("rally list", r"Requesting (\d+) rally items")
        for name, value in (("FENCE_RADIUS", 30), ("FENCE_TYPE", 2), ("FENCE_ACTION", 1)):
            self.console.type(f"param set {name} {value}")
        start = self.up()
        self.console.ask("fence enable", r"DO_FENCE_ENABLE: ACCEPTED")
        end = time.monotonic() + PATIENCE_S
        farthest_m = 0.0
        while not any("Mode RTL" in line for line in self.drained()):
            self.console.type("velocity 5 0 0")
            farthest_m = max(farthest_m, distance_m(start, self.last_place))
            if time.monotonic() > end:
                sys.exit("the fence was not broken")
            time.sleep(0.1)
        from_start_m = self.down(start)
        disabled = self.console.ask("fence disable", r"DO_FENCE_ENABLE: (\w+)")
        return {
            "points": int(points), "rally": int(rally), "farthest_m": farthest_m, "from_start_m": from_start_m,
            "disabled": disabled,
        }  # fmt: skip

    def payload(self) -> dict[str, Any]:
        """DO_MOUNT_CONTROL, which `gimbal angle` says too; that module wants MAVProxy's maps."""
        self.console.expect(r"Received \d+ parameters")
        turned = self.console.ask("long DO_MOUNT_CONTROL -40 0 20 0 0 0 2", r"DO_MOUNT_CONTROL: (\w+)")
        self.console.type("long SET_MESSAGE_INTERVAL 285 100000")
        end = time.monotonic() + 20.0
        values = r"GIMBAL_DEVICE_ATTITUDE_STATUS \{.*q : \[([-\d., e]+)\]"
        pitch_deg = 0.0
        while abs(pitch_deg + 40.0) > 1.0:
            if time.monotonic() > end:
                sys.exit(f"the gimbal stays at {pitch_deg}")
            time.sleep(0.3)
            w, x, y, z = (
                float(value)
                for value in self.console.ask("status GIMBAL_DEVICE_ATTITUDE_STATUS", values).split(",")
            )
            pitch_deg = math.degrees(math.asin(2.0 * (w * y - z * x)))
        return {"turned": turned, "pitch_deg": pitch_deg}

    def drained(self) -> list[str]:
        """Every line that is there."""
        self.console.type("status GLOBAL_POSITION_INT")
        lines = []
        while True:
            line = self.console.lines.get(timeout=PATIENCE_S)
            lines.append(line)
            if match := re.search(r"GLOBAL_POSITION_INT \{.*lat : (-?\d+), lon : (-?\d+)", line):
                self.last_place = int(match[1]) / 1e7, int(match[2]) / 1e7
                return lines


def main() -> None:
    url, *wanted = sys.argv[1:]
    console = Console(url)
    try:
        with tempfile.TemporaryDirectory() as folder:
            run_chapters(Flight(console, Path(folder)), wanted)
    finally:
        console.close()


if __name__ == "__main__":
    main()
