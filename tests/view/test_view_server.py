"""The server of `rebar view`: whom it answers, what it hands out, and that it changes nothing."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random
from urllib.parse import quote

import pytest
from made_view import Ask, asking, cookie_of, finish_last, made_view, served

from bench.cli._app import run
from bench.errors import SetupError
from bench.reporting import csv_text, load_report_data, matching, runs_table, scores_table
from bench.view import CampaignContent, ViewServer, content_of, run_page
from bench.view._content import LOOK_S, REST, Rested

NAIVE = "p000-r0-reference-naive"
ROUTES = (
    *("/", "/app.js", "/api/summary", "/api/runs", "/api/where?where=failed", "/api/run?id=x"),
    *("/api/runs.csv", "/api/live", "/recording?id=x"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_view(tmp_path_factory.mktemp("view") / "c")


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[ViewServer]:
    with served(content_of(folder)) as server:
        yield server


@pytest.fixture
def ask(server: ViewServer) -> Iterator[Ask]:
    with asking(server) as ask:
        yield ask


def state_of(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_only_the_token_opens_it(server: ViewServer, ask: Ask) -> None:
    """No page without the cookie, and the cookie only for the token; a cookie of another server is none."""
    assert server.server_address[0] == "127.0.0.1"
    for route in ROUTES:
        assert ask(route).status == 403, route
    for wrong in ("", "x", server.token[:-1], server.session, f"{server.token}é"):
        answer = ask(f"/?token={wrong.replace('é', '%C3%A9')}")
        assert (answer.status, answer.headers["Set-Cookie"]) == (403, None)
    answer = ask(f"/?token={server.token}")
    assert (answer.status, answer.headers["Location"]) == (303, "/")
    name, *flags = str(answer.headers["Set-Cookie"]).split("; ")
    assert sorted(flags) == ["HttpOnly", "Path=/", "SameSite=Strict"]
    assert server.token not in name
    other = name.replace(str(server.server_port), "1")
    for cookie in (name[:-1], f"{name}x", other, "rebar-view", ";;=,\x7f", ""):
        assert ask("/api/summary", {"Cookie": cookie}).status == 403, cookie
    assert ask("/api/summary", {"Cookie": f"other=1; {name}"}).status == 200


def test_only_its_own_name_is_answered(server: ViewServer, ask: Ask) -> None:
    cookie = cookie_of(server, ask)
    port = server.server_port
    for host, status in {
        f"127.0.0.1:{port}": 200,
        f"localhost:{port}": 200,
        "127.0.0.1": 421,
        f"evil.example:{port}": 421,
        f"127.0.0.1:{port + 1}": 421,
        "": 421,
    }.items():
        assert ask("/api/summary", {**cookie, "Host": host}).status == status, host
    assert ask(f"/?token={server.token}", {"Host": f"evil.example:{port}"}).status == 421


def test_nothing_can_be_written_and_no_other_origin_reads(server: ViewServer, ask: Ask) -> None:
    cookie = cookie_of(server, ask)
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD"):
        assert ask("/api/summary", cookie, method).status == 501
    for route in ("/", "/app.js", "/api/runs", "/nothing", f"/recording?id={NAIVE}"):
        headers = ask(route, cookie).headers
        policy = str(headers["Content-Security-Policy"])
        assert policy.startswith("default-src 'self';")
        assert "unsafe" not in policy
        assert (headers["X-Content-Type-Options"], headers["Referrer-Policy"]) == ("nosniff", "no-referrer")
        assert headers["Access-Control-Allow-Origin"] is None


def test_a_recording_is_handed_out_by_range(server: ViewServer, folder: Path, ask: Ask) -> None:
    """Random ranges are slices of the file; both sides of its end; anything else than a range is the whole file."""
    cookie, data = cookie_of(server, ask), (folder / "runs" / NAIVE / "recording.mcap").read_bytes()
    random = Random(1)
    places = [(random.randrange(len(data)), random.randrange(len(data))) for _ in range(20)]
    ends = [(0, 0), (len(data) - 1, len(data) - 1), (5, len(data) + 99)]
    for first, last in [*map(sorted, places), *ends]:
        answer = ask(f"/recording?id={NAIVE}", {**cookie, "Range": f"bytes={first}-{last}"})
        shown = min(last, len(data) - 1)
        assert (answer.status, answer.headers["Content-Range"]) == (206, f"bytes {first}-{shown}/{len(data)}")
        assert answer.read() == data[first : last + 1]
    answer = ask(f"/recording?id={NAIVE}", {**cookie, "Range": f"bytes={len(data) - 3}-"})
    assert (answer.status, answer.read()) == (206, data[-3:])
    for beyond in (f"bytes={len(data)}-", f"bytes={len(data) + 1}-{len(data) + 2}", "bytes=7-6"):
        assert ask(f"/recording?id={NAIVE}", {**cookie, "Range": beyond}).status == 416
    for other in ("bytes=-5", "lines=1-2", "bytes=1-2,4-5", ""):
        answer = ask(f"/recording?id={NAIVE}", {**cookie, "Range": other})
        assert (answer.status, answer.read()) == (200, data)


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../..", "..%2F..", "%2Fetc", "x", "a%00b", f"../runs/{NAIVE}", f"{NAIVE}/../{NAIVE}"],
)
def test_no_name_leads_elsewhere(name: str, server: ViewServer, ask: Ask) -> None:
    assert ask(f"/recording?id={name}", cookie_of(server, ask)).status == 404


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    """Of a recording, of a run's folder, and of a result; links inside of the folder are followed."""
    folder = made_view(tmp_path / "c")
    outside = tmp_path / "outside"
    runs = folder / "runs"
    for path in (runs / NAIVE, runs / "p001-r0-reference-naive" / "recording.mcap"):
        path.rename(tmp_path / path.name)
        path.symlink_to(tmp_path / path.name)
    result = runs / "p002-r0-reference-naive" / "result.json"
    outside.write_text('{"outcome": "secret"}')
    result.unlink()
    result.symlink_to(outside)
    aware = runs / "p001-r0-reference-bystander-aware" / "recording.mcap"
    aware.rename(folder / "moved.mcap")
    aware.symlink_to(folder / "moved.mcap")
    loop = runs / "p002-r0-reference-bystander-aware" / "recording.mcap"
    loop.unlink()
    loop.symlink_to(loop)
    with served(content_of(folder)) as server, asking(server) as ask:
        cookie = cookie_of(server, ask)
        statuses = [
            [ask(f"/recording?id=p00{scene}-r0-reference-{agent}", cookie).status for scene in range(3)]
            for agent in ("naive", "bystander-aware")
        ]
        assert b"secret" not in ask("/api/run?id=p002-r0-reference-naive", cookie).read()
    assert statuses == [[404, 404, 200], [200, 200, 404]]


def test_looking_shows_the_scores_and_changes_nothing(folder: Path, server: ViewServer, ask: Ask) -> None:
    before, cookie = state_of(folder), cookie_of(server, ask)
    data = load_report_data(folder)
    table = runs_table(data)
    summary = json.loads(ask("/api/summary", cookie).read())
    scores = scores_table(data).filter(configuration="all")
    columns = list(summary["scores"][0])
    assert {"runs", "passed", "passed.low", "score"} < set(columns)
    assert summary["scores"] == scores.select(columns).to_dicts()
    assert (summary["name"], len(summary["plan"]), len(summary["sheets"])) == ("made-up", 7, 2)
    assert summary["signature"]["state"] == "not signed"
    aware = "fog > 0 and not agent == 'reference-naive'"
    for condition in ("KA-18.passed == false", aware, "failed < 0", "run == none"):
        wanted = matching(table, condition, "--where")
        query = f"where={quote(condition)}"
        rows = json.loads(ask(f"/api/where?{query}", cookie).read())["rows"]
        assert [table["run"][row] for row in rows] == wanted["run"].to_list(), condition
        assert ask(f"/api/runs.csv?{query}", cookie).read().decode() == csv_text(wanted)
    assert "fault" in json.loads(ask("/api/where?where=nothing%20%3D%3D%201", cookie).read())
    assert ask("/api/runs.csv?where=nothing", cookie).status == 409
    one = json.loads(ask(f"/api/run?id={NAIVE}", cookie).read())
    assert one["beside"] == sorted(["p000-r0-reference-bystander-aware", NAIVE])
    assert one["nodes"] == data.scores.filter(realization=NAIVE).select(list(one["nodes"][0])).to_dicts()
    assert state_of(folder) == before


def event_of(answer: object) -> dict[str, object]:
    """The next state of a stream of events."""
    while not (line := answer.readline()).startswith(b"data: "):  # type: ignore[attr-defined]
        assert line, "the stream has ended"
    state: dict[str, object] = json.loads(line.removeprefix(b"data: "))
    return state


def test_results_arrive_as_they_come(tmp_path: Path) -> None:
    """An event at once, and one for a result that the journal gets while a page looks."""
    folder = made_view(tmp_path / "c")
    with served(content_of(folder)) as server, asking(server) as ask:
        stream = ask("/api/live", cookie_of(server, ask))
        first = event_of(stream)
        assert (first["done"], first["total"], first["process"]) == (6, 7, None)
        assert str(first["cells"]) == "2222220"
        finish_last(folder)
        second = event_of(stream)
        assert (second["done"], second["cells"]) == (7, "2222222")
        stream.close()


def test_reading_rests_while_the_campaign_flies() -> None:
    """A change is read once the rest is over, which is 99 times the CPU time of the last reading; at once when nothing flies."""
    now_s, spent_s, stamp, busy, reads = [0.0], [0.0], [0], [True], [0]

    def read() -> int:
        spent_s[0] += 0.5
        reads[0] += 1
        return stamp[0]

    value = Rested(read, lambda: stamp[0], lambda: busy[0], lambda: now_s[0], lambda: spent_s[0])
    assert (value.get(), value.get(), reads[0]) == (0, 0, 1)
    stamp[0] = 1
    now_s[0] = REST * 0.5 - 0.001
    assert (value.get(), reads[0]) == (0, 1)
    now_s[0] = REST * 0.5
    assert (value.get(), reads[0]) == (1, 2)
    stamp[0] = 2
    assert value.get() == 1
    busy[0] = False
    assert (value.get(), reads[0]) == (2, 3)
    assert LOOK_S >= 1.0


def test_a_run_or_a_recording_is_shown_by_itself(folder: Path, tmp_path: Path) -> None:
    run_folder = folder / "runs" / NAIVE
    for path in (run_folder, run_folder / "recording.mcap"):
        content = content_of(path)
        assert not isinstance(content, CampaignContent)
        assert content.summary() == {"kind": "run", "name": NAIVE, "run": NAIVE}
        assert content.recording(NAIVE).read_bytes() == (run_folder / "recording.mcap").read_bytes()
        assert content.run(NAIVE)["result"]["outcome"] == "completed"
    for wrong in (tmp_path, tmp_path / "nothing", folder / "campaign.yaml"):
        with pytest.raises(SetupError, match="neither a campaign nor a recording"):
            content_of(wrong)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"a": NaN}', "[" * 100_000])
def test_a_damaged_result_is_none(text: str, tmp_path: Path) -> None:
    (tmp_path / "recording.mcap").write_bytes(b"")
    (tmp_path / "result.json").write_text(text)
    result = content_of(tmp_path).run(tmp_path.name)["result"]
    assert result in ({}, {"a": None})


def test_one_run_as_one_file(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "run.html"
    assert run(["view", str(folder / "runs" / NAIVE), "--to-html", str(page)]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    text = page.read_text()
    assert text == run_page(content_of(folder / "runs" / NAIVE), NAIVE)
    assert text.count("</script>") == 3
    assert "default-src 'none'; script-src 'sha256-" in text
    assert run(["view", str(folder), "--to-html", str(page)]) == 2
    assert "--to-html" in capsys.readouterr().err
    assert isinstance(content_of(folder), CampaignContent)


def test_a_taken_port_is_named(server: ViewServer, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["view", str(folder), "--no-browser", "--port", str(server.server_port)]) == 2
    assert f"rebar: --port: {server.server_port}: " in capsys.readouterr().err


def test_the_command_prints_the_address_and_ends_by_an_interrupt(folder: Path) -> None:
    """Without a display no browser is started, and an interrupt is no fault."""
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in screens}
    command = [sys.executable, "-m", "bench.cli", "view", str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{43}\n", process.stdout.readline())
        # Handed to the server's loop, which is entered after this line.
        assert "Ctrl-C" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate()
    assert (process.returncode, error) == (130, "")
