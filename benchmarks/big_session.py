"""What a session costs whose agent says very much: 100,000 reports and 1,000,000 decisions.

    python benchmarks/big_session.py                    # measures, page and browser
    python benchmarks/big_session.py measures [SCALE]   # CPU seconds of every measure, and how they grow
    python benchmarks/big_session.py page [SCALE]       # the report's page, and Chromium until its map is shown

Nothing is flown: the messages are made and go through the recorder. Everything is printed beside the same for a quiet
session in the same run, as a ratio, because hosts differ. SCALE multiplies the numbers of messages.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
# The made campaign of the report's tests: a folder with everything that a page shows.
sys.path.append(str(ROOT / "tests" / "reporting"))
from made_campaign import AGENTS, Made, made_simspec, made_tape, make_campaign, write_recording  # noqa: E402

from bench.agents._process_usage import ProcessTreeUsage  # noqa: E402
from bench.campaign import load_measurable_decomposition, measure_all, measures_of  # noqa: E402
from bench.contracts import (  # noqa: E402
    AgentTrack,
    AgentTracks,
    CameraFrame,
    Decision,
    SessionResult,
    Sighting,
    SimTime,
    Tape,
    TargetReport,
    Timed,
)
from bench.recording import read_simspec, read_tape  # noqa: E402
from bench.reporting import write_report  # noqa: E402
from bench.simspec import SimSpec  # noqa: E402

REPORTS, DECISIONS, TRACK_MESSAGES, TRACKS = 100_000, 1_000_000, 1000, 100
ACTIONS = ("report", "mark", "withhold_mark", "search", "degraded", "restored")
BROWSER_TRIES = 5


def at(time_s: float) -> SimTime:
    return SimTime(round(time_s * 1e9))


def flooded(tape: Tape, simspec: SimSpec, scale: float) -> Tape:
    """The tape with very many messages: reports about actors, at one empty place and all over the area; few subjects."""
    random = np.random.default_rng(7)
    names = [item.id for item in simspec.intelligence]

    def moments(count: int) -> list[float]:
        return [float(time_s) for time_s in np.sort(random.uniform(1.0, tape.end_s, round(scale * count)))]

    def place_near(time_s: float, number: int) -> tuple[float, float, str]:
        actor = int(random.integers(len(tape.cast)))
        place = (
            tape.actors_at(time_s)[actor][:2] + random.normal(0.0, 3.0, 2),
            np.array([33.0, 44.0]),
            random.uniform(-290.0, 290.0, 2),
        )[number % 3]
        return float(place[0]), float(place[1]), tape.cast[actor].class_label

    reports = []
    for number, time_s in enumerate(moments(REPORTS)):
        east_m, north_m, label = place_near(time_s, number)
        report = TargetReport(
            id=f"r{number}",
            time_s=time_s,
            class_label=label,
            east_m=east_m,
            north_m=north_m,
            confidence=0.8,
            mark=bool(number % 2),
            intelligence_id=names[number % len(names)],
            bystanders_seen=1,
            position_sigma_m=5.0,
            reason="seen from three sides",
        )
        reports.append(Timed(at(time_s), report))
    decisions = [
        Timed(at(time_s), Decision(time_s=time_s, action=ACTIONS[number % 6], subject=names[number % 2]))
        for number, time_s in enumerate(moments(DECISIONS))
    ]
    tracks = []
    for time_s in moments(TRACK_MESSAGES):
        places = [place_near(time_s, number) for number in range(TRACKS)]
        held = tuple(
            AgentTrack(
                id=f"t{number}",
                class_label=label,
                east_m=east_m,
                north_m=north_m,
                confidence=0.7,
                frames=number % 9,
            )
            for number, (east_m, north_m, label) in enumerate(places)
        )
        tracks.append(Timed(at(time_s), AgentTracks(time_s=time_s, tracks=held)))
    return replace(
        tape, reports=tuple(reports), decisions=tuple(decisions), tracks=tuple(tracks), frames=_frames(tape)
    )


def _frames(tape: Tape) -> tuple[CameraFrame, ...]:
    """A picture a second, with ten actors in each."""
    return tuple(
        CameraFrame(
            number,
            "camera",
            at(number),
            tuple(
                Sighting((number + row) % len(tape.cast), 40.0, 30.0, 1.0, (0.0, 0.0, 9.0, 9.0))
                for row in range(10)
            ),
        )
        for number in range(1, int(tape.end_s))
    )


def measures(scale: float) -> None:
    """CPU seconds of all measures, and of those that took most, at a tenth of the messages and at all of them."""
    simspec = made_simspec(0, AGENTS[0])
    empty = made_tape(simspec)
    requests = measures_of(load_measurable_decomposition("search-and-report-full"))
    quiet_s = _cpu_s(measure_all, requests, replace(empty), simspec)
    tapes = [flooded(empty, simspec, part * scale) for part in (0.1, 1.0)]
    whole_s = [_cpu_s(measure_all, requests, replace(tape), simspec) for tape in tapes]
    print(f"quiet {quiet_s:.2f} s CPU, a tenth {whole_s[0]:.2f} s, all {whole_s[1]:.2f} s: "
          f"{whole_s[1] / whole_s[0]:.1f} times a tenth, {whole_s[1] / quiet_s:.0f} times quiet")  # fmt: skip
    spent: dict[str, list[float]] = {}
    for tape in tapes:
        # One copy: what measures share is paid by the first of them, as in a campaign.
        shared = replace(tape)
        for observable, request in requests.items():
            spent.setdefault(observable, []).append(
                _cpu_s(measure_all, {observable: request}, shared, simspec)
            )
    for observable in sorted(spent, key=lambda name: -spent[name][1])[:12]:
        few_s, many_s = spent[observable]
        print(
            f"  {observable} {requests[observable][0]:<28}{many_s:8.2f} s CPU{many_s / few_s:8.1f} times a tenth"
        )


def _cpu_s(work: Callable[..., object], *arguments: object) -> float:
    began = time.process_time()
    work(*arguments)
    return time.process_time() - began


def page(scale: float) -> None:
    """CPU seconds and bytes of two pages, and Chromium's time with each in turn."""
    with tempfile.TemporaryDirectory() as folder:
        pages = {}
        for name, part in (("quiet", 0.0), ("flooded", scale)):
            campaign = written_session(Path(folder) / name, part)
            spent_s = _cpu_s(write_report, campaign)
            pages[name] = campaign / "report.html"
            print(
                f"{name:<8} page: {spent_s:7.2f} s CPU,{pages[name].stat().st_size / 1e6:6.2f} MB", flush=True
            )
        recording = Path(folder) / "flooded" / "runs" / f"p000-r0-{AGENTS[0]}" / "recording.mcap"
        print(f"recording of {recording.stat().st_size / 1e6:.0f} MB, read in "
              f"{_cpu_s(read_tape, recording, read_simspec(recording)):.2f} s CPU", flush=True)  # fmt: skip
        if program := shutil.which("chromium") or shutil.which("google-chrome"):
            compare_pages(program, pages)


def written_session(folder: Path, scale: float) -> Path:
    """A campaign of one scene and two agents, the first of which floods."""
    campaign = make_campaign(folder, Made(scenes=1))
    for agent in AGENTS:
        run = campaign / "runs" / f"p000-r0-{agent}"
        simspec = made_simspec(0, agent)
        tape = made_tape(simspec)
        if agent == AGENTS[0] and scale:
            # `write_recording` records no tracks and no camera.
            tape = flooded(tape, simspec, scale)
        sha256 = write_recording(run / "recording.mcap", simspec, tape)
        result = SessionResult.model_validate_json((run / "result.json").read_text())
        (run / "result.json").write_text(
            result.model_copy(update={"recording_sha256": sha256}).model_dump_json()
        )
    return campaign


# Asked in the page. The map is shown once Plotly has drawn it and the browser has painted a frame after that.
SHOWN = """new Promise((resolve) => {
  const box = document.querySelector('.figure.map');
  box.scrollIntoView();
  const look = () => box.dataset.drawn
    ? requestAnimationFrame(() => setTimeout(() => resolve({
        loaded_s: performance.timing.loadEventEnd / 1000 - performance.timing.navigationStart / 1000,
        shown_s: performance.now() / 1000})))
    : setTimeout(look, 5);
  look();
})"""


def compare_pages(program: str, pages: dict[str, Path]) -> None:
    """Wall and CPU seconds until each page is loaded and its map is shown; medians, and their ratios."""
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in pages}
    for _ in range(BROWSER_TRIES):
        # In turn, so that a drift of the host falls on all.
        for name, path in pages.items():
            with open_browser(program) as browser:
                runs[name].append(browser.visit(path))
    middles = {
        name: {key: median(timings[key] for timings in tries) for key in tries[0]}
        for name, tries in runs.items()
    }
    for name, middle in middles.items():
        words = {"loaded_s": "loaded after", "shown_s": "map shown after", "cpu_s": "CPU of all its processes",
                 "task_s": "of its main thread"}  # fmt: skip
        print(
            f"{name:<8} in Chromium: {', '.join(f'{text} {middle[key]:.2f} s' for key, text in words.items())}"
        )
    quiet, flooded = middles["quiet"], middles["flooded"]
    print(f"flooded over quiet: {flooded['shown_s'] / quiet['shown_s']:.2f} times the wall time until the map is shown, "
          f"{flooded['cpu_s'] / quiet['cpu_s']:.2f} times the CPU time")  # fmt: skip


class Browser:
    """Chromium by its DevTools protocol: JSON messages, each ended by a zero byte."""

    def __init__(self, pid: int, commands: int, answers: int) -> None:
        self._commands, self._answers = commands, answers
        self._usage = ProcessTreeUsage(pid, home=None)
        self._rest = b""
        self._number = 0

    def visit(self, path: Path) -> dict[str, float]:
        """Open a file in a new tab, scroll to its first map, and say when it was loaded and shown."""
        target = self._call("Target.createTarget", {"url": "about:blank"})
        attached = self._call("Target.attachToTarget", {"targetId": target["targetId"], "flatten": True})
        session: str = attached["sessionId"]
        self._call("Page.enable", {}, session)
        # By the clock of the thread: the wall's depends on what else the host does.
        self._call("Performance.enable", {"timeDomain": "threadTicks"}, session)
        began_cpu_s = self._usage.read().cpu_s
        self._call("Page.navigate", {"url": path.as_uri()}, session)
        self._wait_for("Page.loadEventFired", session)
        question = {"expression": SHOWN, "awaitPromise": True, "returnByValue": True}
        answer: dict[str, float] = self._call("Runtime.evaluate", question, session)["result"]["value"]
        cpu_s = self._usage.read().cpu_s - began_cpu_s
        metrics = self._call("Performance.getMetrics", {}, session)["metrics"]
        spent = {metric["name"]: metric["value"] for metric in metrics}
        return answer | {"cpu_s": cpu_s, "task_s": spent["TaskDuration"]}

    def _call(self, method: str, parameters: dict[str, Any], session: str | None = None) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        os.write(
            self._commands, json.dumps(message | ({"sessionId": session} if session else {})).encode() + b"\0"
        )
        while (answer := self._receive()).get("id") != self._number:
            pass
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        result: dict[str, Any] = answer["result"]
        return result

    def _wait_for(self, event: str, session: str) -> None:
        while True:
            message = self._receive()
            if message.get("method") == event and message.get("sessionId") == session:
                return

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            self._rest += os.read(self._answers, 1 << 20)
        line, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message


@contextmanager
def open_browser(program: str) -> Iterator[Browser]:
    """A fresh Chromium, without a cache."""
    commands_read, commands_write = os.pipe()
    answers_read, answers_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        # It takes its commands from descriptor 3, and answers on 4.
        script = f'exec "$@" 3<&{commands_read} 4>&{answers_write}'
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--window-size=1280,900",
            "--remote-debugging-pipe",
            f"--user-data-dir={profile}",
        ]
        started = subprocess.Popen(
            ["bash", "-c", script, "bash", program, *options],
            pass_fds=(commands_read, answers_write),
            stderr=subprocess.DEVNULL,
        )
        os.close(commands_read)
        os.close(answers_write)
        try:
            yield Browser(started.pid, commands_write, answers_read)
        finally:
            # Its end of commands is its end.
            os.close(commands_write)
            started.terminate()
            started.wait(20.0)
            os.close(answers_read)


def main() -> None:
    """Both parts, or the one that is named."""
    parts = {"measures": measures, "page": page}
    named = [sys.argv[1]] if len(sys.argv) > 1 else list(parts)
    scale = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
    for name in named:
        parts[name](scale)


if __name__ == "__main__":
    main()
