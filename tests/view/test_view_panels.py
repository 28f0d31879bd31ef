"""The page of `rebar view` in a browser: every panel, its numbers, and what hostile or half-written runs make of it."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import polars as pl
import pytest
from browser import Browser, needs_chromium, open_browser
from made_view import MARKED_S, STAGES, finish_last, fly, made_view, served

from bench.contracts import Outcome, Record, SessionResult, SimTime, TargetReport, VehicleTopics
from bench.reporting import load_report_data, matching, runs_table, scores_table
from bench.streams import (
    BoundingBox2D,
    CompressedImage,
    Detection2D,
    Detection2DArray,
    Header,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    Point2D,
    Pose2D,
    Time,
    encode,
)
from bench.view import CampaignContent, Content, ViewServer, content_of, run_page
from bench.visible_text import visible

from made_campaign import _document_record, made_simspec, made_tape, write_recording  # isort: skip  # made_view puts its folder on the path

pytestmark = needs_chromium
NAIVE, AWARE = "p000-r0-reference-naive", "p000-r0-reference-bystander-aware"
HOSTILE = (
    "<b id=planted>bold</b> <script>document.title='taken'</script> &amp; "
    "\x1b[2J\x07 \u202eright\u202c \u200bzero\ufeff \u2028line {{7*7}} \"' \U000e0041"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_view(tmp_path_factory.mktemp("view") / "c", reason=HOSTILE)


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[ViewServer]:
    with served(content_of(folder)) as server:
        yield server


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """The browser of all tests: its start takes longer than most of them."""
    with open_browser() as browser:
        yield browser


@pytest.fixture
def page(chromium: Browser, server: ViewServer) -> Iterator[Browser]:
    """The page, at 1440 x 900. After each test: no error, and nothing was asked of anybody but the server."""
    if chromium.address != server.address:
        chromium.renew()
        chromium.open(server.address)
        chromium.wait("document.querySelector('.verdicts')")
    chromium.resize(1440, 900)
    yield chromium
    assert chromium.faults == []
    home = f"http://127.0.0.1:{server.server_port}/"
    assert [
        address for address in chromium.requests if not address.startswith((home, "blob:", "about:"))
    ] == []
    assert chromium.run("document.querySelector('#planted') === null && document.title !== 'taken'")


@contextmanager
def opened(chromium: Browser, content: Content) -> Iterator[Browser]:
    """This content on a page of its own, which is left before its server ends."""
    with served(content) as server:
        chromium.renew()
        chromium.open(server.address)
        try:
            yield chromium
        finally:
            chromium.renew()


@contextmanager
def shown(chromium: Browser, content: Content) -> Iterator[Browser]:
    """Likewise. At the end: no error."""
    with opened(chromium, content) as browser:
        browser.wait("document.querySelector('nav')")
        yield browser
        assert browser.faults == []


def run_folder(folder: Path, recording: bytes = b"") -> Path:
    (folder / "run").mkdir()
    (folder / "run" / "recording.mcap").write_bytes(recording)
    return folder / "run"


def texts(page: Browser, selector: str) -> list[str]:
    found: list[str] = page.run(
        f"[...document.querySelectorAll({json.dumps(selector)})].map((e) => e.innerText.trim())"
    )
    return found


def test_verdicts_are_the_scores_and_lead_to_the_runs(page: Browser, folder: Path) -> None:
    """Opened down to the observables, every count is that of the scores; a click shows the runs behind it."""
    data = load_report_data(folder)
    page.go("#/verdict")
    page.wait("document.querySelector('.verdicts')")
    for level, count in (("vab", 5), ("observable", 10)):
        page.run("document.querySelectorAll('.opener[aria-expanded=false]').forEach((e) => e.click())")
        page.wait(f"document.querySelectorAll('.level-{level}').length === {count}")
    counts = page.run(
        "[...document.querySelectorAll('td[data-node]')].map((e) => [e.dataset.agent, e.dataset.node, "
        "...e.querySelector('.count').innerText.split(' of ').map(Number)])"
    )
    scores = scores_table(data).filter(pl.col("configuration") == "all", pl.col("runs") > 0)
    wanted_counts = scores.select("agent", "node", "passed", "runs").rows()
    assert sorted(map(tuple, counts)) == sorted(wanted_counts)
    assert len(counts) == 2 * (2 + 5 + 5 + 10)
    page.run('document.querySelector(\'td[data-node="KA-18"][data-agent="reference-naive"] a\').click()')
    table = runs_table(data)
    condition = 'agent == "reference-naive" and KA-18.passed == false'
    wanted = matching(table, condition, "--where")["run"].to_list()
    assert wanted
    page.wait(f"document.querySelectorAll('tr[data-row]').length === {len(wanted)}")
    assert page.run("[...document.querySelectorAll('tr[data-row]')].map((e) => e.dataset.row)") == wanted


def type_filter(page: Browser, text: str) -> None:
    page.run(
        f"(() => {{ const e = document.getElementById('where'); e.value = {json.dumps(text)}; e.dispatchEvent(new Event('input', {{bubbles: true}})); }})()"
    )


def test_runs_are_filtered_by_the_words_of_the_command_and_sorted(page: Browser, folder: Path) -> None:
    table = runs_table(load_report_data(folder))
    page.go("#/runs")
    page.wait("document.querySelectorAll('tr[data-row]').length === 6")
    for condition in ("failed >= 2", "KA-18.passed == true or fog == 1", "not agent == 'reference-naive'"):
        type_filter(page, condition)
        wanted = matching(table, condition, "--where")["run"].to_list()
        page.wait(
            f"[...document.querySelectorAll('tr[data-row]')].map((e) => e.dataset.row).join() === '{','.join(wanted)}'"
        )
        page.wait(f"document.querySelector('.filter output').innerText === '{len(wanted)} of 6 runs'")
        page.wait(f"decodeURIComponent(location.hash).endsWith({json.dumps(condition)})")
    type_filter(page, "fog >")
    page.wait("document.querySelector('.filter output.bad')")
    type_filter(page, "")
    page.wait("document.querySelectorAll('tr[data-row]').length === 6")
    for direction in ("ascending", "descending"):
        page.run("document.querySelector('th[data-column=failed] button').click()")
        page.wait(f"document.querySelector('th[data-column=failed]').ariaSort === '{direction}'")
        place = page.run("document.querySelector('th[data-column=failed]').cellIndex")
        failed = [int(text) for text in texts(page, f"tr[data-row] td:nth-child({place + 1})")]
        assert failed == sorted(failed, reverse=direction == "descending")
    # Two picked rows lead to the pair, a click on a row to its run.
    page.run("[...document.querySelectorAll('tr[data-row^=p000] input')].forEach((e) => e.click())")
    pair = page.wait("document.querySelector('a.button[href^=\"#/pair/\"]').href")
    assert pair.endswith(("naive", "aware"))
    page.run(f"document.querySelector('tr[data-row=\"{NAIVE}\"] td.n').click()")
    page.wait(f"location.hash.startsWith('#/run/{NAIVE}')")


def facts(page: Browser) -> dict[str, str]:
    rows: list[list[str]] = page.run(
        "[...document.querySelectorAll('[data-fact]')].map((e) => [e.dataset.fact, e.querySelector('dd').innerText])"
    )
    return dict(rows)


def show_moment(page: Browser, name: str, time_s: float) -> None:
    page.go(f"#/run/{name}?t={time_s}")
    page.wait(f"document.querySelector('.run-head h1').innerText === '{name}'")
    page.wait(f"document.querySelector('.time').innerText.startsWith('{time_s:.1f} s')")


def test_a_moment_is_that_of_the_recording(page: Browser) -> None:
    """A link to a moment shows the place, height and nearest person that the tape had then."""
    tape = made_tape(made_simspec(0, "reference-naive"))
    people = [index for index, member in enumerate(tape.cast) if member.role.value == "bystander"]
    for time_s in (0.0, 27.4, MARKED_S, 101.8):
        show_moment(page, NAIVE, time_s)
        row = int(abs(tape.vehicle_time_s - time_s).argmin())
        east_m, north_m, height_m = tape.vehicle_position_enu_m[row]
        shown = facts(page)
        place_m = [float(part) for part in shown["east, north"].removesuffix(" m").split(", ")]
        assert place_m == pytest.approx([east_m, north_m], abs=0.51)
        assert float(shown["height"].removesuffix(" m")) == pytest.approx(height_m, abs=0.051)
        # Everybody stands on the ground, and the rules count in three dimensions.
        offsets = tape.actor_position_enu_m[int(time_s)][people] - tape.vehicle_position_enu_m[row]
        nearest_m = min((offsets**2).sum(axis=1) ** 0.5)
        assert float(shown["nearest person"].removesuffix(" m")) == pytest.approx(nearest_m, abs=0.51)
    assert facts(page)["phase"] == "returning"


def test_the_player_plays_and_has_a_lane_for_everything(page: Browser) -> None:
    show_moment(page, NAIVE, 30.0)
    lanes = dict(
        page.run(
            "[...document.querySelectorAll('[data-lane]')].map((e) => [e.dataset.lane, e.querySelectorAll('rect').length])"
        )
    )
    # The failure at 250 s is beyond the end.
    wanted = {"phase": 3, "orders": 3, "outages": 3, "reports": 2, "decisions": 3, "measured": 2}
    assert {name: lanes[name] for name in wanted} == wanted
    time = "parseFloat(document.querySelector('.time').innerText)"
    for key, time_s in (("ArrowRight", 31), ("ArrowLeft", 30), ("ArrowLeft", 29), ("Home", 0)):
        page.press(key)
        page.wait(f"{time} === {time_s}")
    page.press(" ")
    page.wait(f"{time} > 0.3")
    page.press(" ")
    stopped = page.wait(
        "document.querySelector('.play').ariaLabel === 'Play' && document.querySelector('.time').innerText"
    )
    assert stopped == page.run("document.querySelector('.time').innerText")
    page.wait("location.hash.endsWith('?t=' + document.querySelector('.time').innerText.split(' ')[0])")
    # A click on a lane goes there: half of the width is half of the time.
    box = page.run(
        "(() => { const b = document.querySelector('[data-lane=decisions]').parentNode.ownerSVGElement.getBoundingClientRect(); return [b.left, b.top, b.width] })()"
    )
    page.click(box[0] + 96 + (box[2] - 96) / 2, box[1] + 30)
    page.wait(f"Math.abs({time} - 60) < 0.5")
    page.run("document.querySelector('.failures button').click()")
    page.wait(f"{time} === {MARKED_S}")
    # Beside every observable that the run failed, how far the agent came.
    lines = texts(page, ".failures .stages")
    assert lines == [STAGES] * len(texts(page, ".failures li"))
    assert lines


def test_words_of_an_agent_are_text_with_every_character_seen(page: Browser) -> None:
    show_moment(page, NAIVE, MARKED_S)
    page.wait("document.querySelector('.entry.now')")
    page.run("[...document.querySelectorAll('.entry.k-decision')].at(-1).click()")
    page.wait("document.querySelector('.whole p')")
    assert page.run("document.querySelector('.whole p').textContent") == visible(HOSTILE)
    assert visible(HOSTILE).replace("\\", "\\\\")[:60] in page.run(
        "document.querySelector('.whole pre').textContent"
    ).replace('\\"', '"')
    shown = page.run("document.body.textContent")
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\ufeff\U000e0041]", shown)


def test_every_text_is_shown_as_the_bench_shows_it(tmp_path: Path, chromium: Browser) -> None:
    """The script escapes what `visible` escapes: random texts of ordinary and hidden characters."""
    random = Random(7)
    pools = [(0, 0x250), (0x600, 0x700), (0x2000, 0x2100)]
    pools += [(0xFFF0, 0xFFFC), (0x13420, 0x13440), (0xE0000, 0xE0110)]
    for number in range(2):
        text = "".join(chr(random.randrange(*random.choice(pools))) for _ in range(300))
        name = f"p00{number}-r0-reference-naive"
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        result = SessionResult(realization=name, outcome=Outcome.COMPLETED)
        (folder / "result.json").write_text(result.model_dump_json())
        fly(tmp_path, name, text)
        with shown(chromium, content_of(folder)) as browser:
            browser.wait("document.querySelector('.entry.k-decision')")
            browser.run("document.querySelector('.entry.k-decision').click()")
            browser.wait("document.querySelector('.whole p')")
            assert browser.run("document.querySelector('.whole p').textContent") == visible(text)


def test_the_pair_marks_the_first_difference(page: Browser) -> None:
    """Both fly the same path and say the same until one of them marks what the other only reports."""
    page.go(f"#/pair/{NAIVE}/{AWARE}?t=5")
    button = page.wait("document.querySelector('.first').innerText")
    assert button == f"first difference at {MARKED_S:.1f} s"
    head = page.run("document.querySelector('.run-head').innerText")
    assert "mark mobile_radar | report mobile_radar" in head
    page.run("document.querySelector('.first').click()")
    page.wait(f"document.querySelector('.time').innerText.startsWith('{MARKED_S:.1f} s')")
    assert page.run("document.querySelectorAll('.differs').length") == 2
    page.go(f"#/pair/{NAIVE}/{NAIVE}")
    page.wait("document.querySelector('.first').innerText === 'no difference'")
    page.go(f"#/pair/{NAIVE}/p001-r0-reference-naive")
    page.wait("document.querySelector('.remark')")


def test_the_matrix_is_that_of_the_scores_and_opens_the_moment(page: Browser, folder: Path) -> None:
    data = load_report_data(folder)
    table = runs_table(data)
    page.go("#/matrix")
    page.wait("document.querySelector('.matrix canvas').width > 0")
    page.run("document.querySelector('.matrix').focus()")
    order = table.sort("design_point", "replicate", "agent")["run"].to_list()
    observables = [node.id for node in data.nodes.values() if node.level == "observable"]
    page.press("ArrowRight")
    seen = set()
    for step in range(12):
        state, node, _, name = re.match(
            r"(passed|failed|not considered) \S+, (\S+) (.*) · (\S+)",
            page.wait("document.querySelector('.readout b') && document.querySelector('.readout').innerText"),
        ).groups()  # type: ignore[union-attr]
        assert name in order[: 1 + step]
        assert node in observables
        passed = table.filter(run=name)[f"{node}.passed"][0]
        assert state == {True: "passed", False: "failed", None: "not considered"}[passed]
        seen.add((name, node))
        page.press("ArrowRight" if step % 2 else "ArrowDown")
    assert len(seen) > 9
    # A cell of KA-18, whose moment the result has.
    box = page.run(
        "(() => { const b = document.querySelector('.matrix canvas').getBoundingClientRect(); return [b.left, b.top] })()"
    )
    for x in range(9, 190, 18):
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=box[0] + 236 + x, y=box[1] + 214 + 9)
        if "OBS-181" in page.wait("document.querySelector('.readout').innerText"):
            page.click(box[0] + 236 + x, box[1] + 214 + 9)
            break
    page.wait(f"location.hash === '#/run/{order[0]}?t={MARKED_S:.1f}'")


def test_the_page_to_sign_has_the_verdicts_and_the_digests(page: Browser, folder: Path) -> None:
    page.go("#/sign")
    page.wait("document.querySelectorAll('.sheet').length === 2")
    summary: dict[str, Any] = content_of(folder).summary()
    for place, sheet in enumerate(summary["sheets"], 1):
        columns = ("passed", "interval", "competence", "floor")
        cells = [row[column] for row in sheet["rows"] for column in columns]
        assert texts(page, f".sheet:nth-of-type({place}) tbody td") == cells
    assert summary["manifest_sha256"] in page.run("document.body.innerText")
    assert "not signed" in page.run("document.querySelector('.sheet').innerText")


def test_live_shows_a_result_that_comes(folder: Path, tmp_path: Path, chromium: Browser) -> None:
    copy = shutil.copytree(folder, tmp_path / "c")
    with shown(chromium, content_of(copy)) as browser:
        browser.go("#/live")
        browser.wait("document.querySelector('[data-live=done]').innerText === '6 of 7'")
        last = finish_last(copy)
        browser.wait("document.querySelector('[data-live=done]').innerText === '7 of 7'")
        assert last in browser.wait("document.querySelector('.news').innerText")


@pytest.mark.parametrize("share", [0.0, 0.97])
def test_a_run_half_written_is_shown_as_far_as_it_is(
    share: float, folder: Path, tmp_path: Path, chromium: Browser
) -> None:
    """Cut at any place, also within a chunk; what is there is shown, and that it is not all."""
    data = (folder / "runs" / NAIVE / "recording.mcap").read_bytes()
    with shown(chromium, content_of(run_folder(tmp_path, data[: int(share * len(data))]))) as browser:
        assert "is not complete" in browser.wait("document.querySelector('.remark').innerText")
        assert "no result yet" in browser.run("document.querySelector('.run-verdict').innerText")


def test_a_damaged_recording_says_so(folder: Path, tmp_path: Path, chromium: Browser) -> None:
    data = bytearray((folder / "runs" / NAIVE / "recording.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    with shown(chromium, content_of(run_folder(tmp_path, bytes(data)))) as browser:
        assert "cannot be read to its end" in browser.wait("document.querySelector('.remark').innerText")


def test_thousands_of_rows_scroll(folder: Path, chromium: Browser) -> None:
    """The document holds the rows in view alone; the last row comes into view, sorted and filtered ones too."""
    content = content_of(folder)
    assert isinstance(content, CampaignContent)
    few = runs_table(load_report_data(folder))
    places = pl.DataFrame({"place": [f"q{place:04d}-" for place in range(700)]})
    many = places.join(few, how="cross").with_columns(run=pl.col("place") + pl.col("run")).drop("place")
    assert many.height > 4_000
    content._table.get = lambda: many  # type: ignore[method-assign]
    with shown(chromium, content) as browser:
        browser.go("#/runs")
        browser.wait("document.querySelectorAll('tr[data-row]').length > 20")
        for condition, rows in (("", many), ("fog == 1", matching(many, "fog == 1", "--where"))):
            type_filter(browser, condition)
            count = f"{rows.height} of {many.height} runs"
            browser.wait(f"document.querySelector('.filter output').innerText === '{count}'")
            # Scrolled at each look: a new filter sends the table to its top, some time after the count is shown.
            browser.wait(
                "(document.querySelector('.rows').scrollTop = 1e9,"
                f" [...document.querySelectorAll('tr[data-row]')].at(-1).dataset.row === '{rows['run'][-1]}')"
            )
            assert browser.run("document.querySelectorAll('tr[data-row]').length") < 100
        browser.go("#/matrix")
        browser.wait("document.querySelector('.matrix canvas').width > 0")
        browser.run("document.querySelector('.matrix').scrollTop = 1e9")


def test_a_run_in_one_file_asks_for_nothing(folder: Path, tmp_path: Path, chromium: Browser) -> None:
    path = tmp_path / "run.html"
    path.write_text(run_page(content_of(folder / "runs" / NAIVE), NAIVE))
    address = f"{path.as_uri()}#/run/{NAIVE}?t=60"
    chromium.renew()
    chromium.open(address)
    chromium.wait("document.querySelector('.time').innerText.startsWith('60.0 s')")
    tape = made_tape(made_simspec(0, "reference-naive"))
    height_m = tape.vehicle_position_enu_m[int(abs(tape.vehicle_time_s - 60.0).argmin())][2]
    assert facts(chromium)["height"] == f"{height_m:.1f} m"
    assert texts(chromium, "nav a") == ["REBAR"]
    assert {*chromium.requests} <= {address, path.as_uri()}
    assert chromium.faults == []
    assert chromium.run("document.querySelector('#planted') === null && document.title !== 'taken'")


@pytest.mark.parametrize(
    "panel", ["verdict", "runs", "matrix", "live", "sign", f"run/{NAIVE}?t=60", f"pair/{NAIVE}/{AWARE}"]
)
def test_no_panel_is_wider_than_its_window(panel: str, page: Browser) -> None:
    for width, dark in ((390, False), (800, True), (1440, False)):
        page.resize(width, 900, dark=dark)
        page.go(f"#/{panel}")
        page.wait("!document.querySelector('.wait') && document.querySelector('main').firstChild")
        assert page.run("document.documentElement.scrollWidth - innerWidth") <= 0, width


def nothing_flown(folder: Path) -> None:
    shutil.rmtree(folder / "runs")
    for name in ("scores.parquet", "manifest.json"):
        (folder / name).unlink()


def half_copied(folder: Path) -> None:
    (folder / "scores.parquet").write_bytes((folder / "scores.parquet").read_bytes()[:500])
    (folder / "decomposition.json").unlink()
    (folder / "runs" / NAIVE / "result.json").write_text('{"realization": "p0')
    (folder / "simspecs" / f"{AWARE}.json").unlink()
    shutil.rmtree(folder / "runs" / "p001-r0-reference-naive")


def one_run(folder: Path) -> None:
    for path in (*(folder / "runs").iterdir(), *(folder / "simspecs").iterdir()):
        if not path.name.startswith(NAIVE):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    scores = pl.read_parquet(folder / "scores.parquet")
    scores.filter(realization=NAIVE).write_parquet(folder / "scores.parquet")


@pytest.mark.parametrize("spoil", [nothing_flown, half_copied, one_run])
def test_odd_campaigns_have_every_panel(
    spoil: Callable[[Path], None], folder: Path, tmp_path: Path, chromium: Browser
) -> None:
    copy = shutil.copytree(folder, tmp_path / "c")
    spoil(copy)
    with shown(chromium, content_of(copy)) as browser:
        browser.wait("document.querySelector('.verdicts')")
        for panel in ("runs", "matrix", "live", "sign", "verdict"):
            browser.go(f"#/{panel}")
            current = f"document.querySelector('nav [aria-current]').hash === '#/{panel}'"
            browser.wait(f"{current} && document.querySelector('main').innerText")
        assert browser.faults == []
        browser.go("#/run/p002-r0-reference-naive")
        browser.wait("document.querySelector('.run-head, [role=alert]')")
        # Of a recording that is not there.
        browser.faults.clear()


def test_many_reports_and_detections_play(tmp_path: Path, chromium: Browser) -> None:
    """900 reports and 100,000 detections: the log holds the rows in view, and the lane one bar for each pixel."""
    folder = run_folder(tmp_path)
    simspec = made_simspec(0, "reference-naive")
    topics = VehicleTopics(simspec.vehicle.name)
    truck: dict[str, Any] = {"class_label": "truck", "north_m": 0.0, "confidence": 0.9}
    spread = [
        TargetReport(id=f"r{n}", time_s=n / 9, east_m=n / 9, mark=n % 2 == 0, **truck) for n in range(900)
    ]
    reports = [_document_record(report.time_s, topics.reports, report) for report in spread]
    result = ObjectHypothesisWithPose(ObjectHypothesis("civilian", 0.8))
    found = Detection2D(results=(result,), bbox=BoundingBox2D(Pose2D(Point2D(10.0, 10.0)), 4.0, 4.0), id="t")
    frame = encode(Detection2DArray(Header(Time.of(0), "f"), (found,) * 100))
    times = (SimTime(n * 10**8) for n in range(1000))
    frames = [Record(time, topics.detections, Detection2DArray.TYPE, frame) for time in times]
    write_recording(folder / "recording.mcap", simspec, made_tape(simspec), [*reports, *frames])
    with shown(chromium, content_of(folder)) as browser:
        browser.wait("document.querySelector('[data-lane=reports]')")
        assert browser.run("document.querySelectorAll('[data-lane=reports] rect').length") == 902
        assert 100 < browser.run("document.querySelectorAll('[data-lane=detections] rect').length") < 1440
        browser.press("End")
        browser.wait("document.querySelector('.entry.now')")
        assert browser.run("document.querySelectorAll('.entry').length") < 100


def test_the_camera_shows_the_recorded_picture(tmp_path: Path, chromium: Browser) -> None:
    folder = run_folder(tmp_path)
    simspec = made_simspec(0, "reference-naive")
    topic = f"/{simspec.vehicle.name}/camera/{simspec.vehicle.camera.name}/image_raw/compressed"
    pictures = []
    for time_s, bgr in ((10, (0, 0, 255)), (50, (255, 0, 0))):
        _, jpeg = cv2.imencode(".jpg", np.full((72, 128, 3), bgr, dtype=np.uint8))
        message = CompressedImage(Header(Time.of(time_s * 10**9), "front"), "jpeg", jpeg.tobytes())
        pictures.append(Record(SimTime(time_s * 10**9), topic, CompressedImage.TYPE, encode(message)))
    write_recording(folder / "recording.mcap", simspec, made_tape(simspec), pictures)
    with opened(chromium, content_of(folder)) as browser:
        browser.wait("document.querySelector('.camera canvas')")
        canvas = "document.querySelector('.camera canvas')"
        pixel = f"[...{canvas}.getContext('2d').getImageData(40, 40, 1, 1).data]"
        for time_s, (loud, quiet) in ((20, (0, 2)), (60, (2, 0))):
            browser.go(f"#/run/run?t={time_s}")
            browser.wait(f"{pixel}[{loud}] > 240 && {pixel}[{quiet}] < 15")
        # Of the test's own looks at the pixels.
        assert [fault for fault in browser.faults if "getImageData" not in fault] == []
