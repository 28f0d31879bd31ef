"""The cache of an agent: filled once, confined, read-only for sessions, another one for another agent."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest
import yaml
from rungs import CONFINING, EVERY, rung_or_skip
from started_agents import EXAMPLE, exit_code, plan_of

from bench.agents import cache_faults, load_manifest, open_agent, open_cache, program_faults
from bench.campaign import (
    Campaign,
    CampaignAgent,
    RunOptions,
    fly_realization,
    load_measurable_decomposition,
    run_campaign_sync,
)
from bench.contracts import AgentCache, Outcome
from bench.errors import SetupError
from bench.simspec import AgentSpec, Mission, Point, Polygon, SimSpec, VehicleSpec, World, load_simspec

AREA = Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (50, 0), (50, 50))))
# Every filling is another one, in a file and in a link; it must not find the host's network.
PREPARE = """\
import os, pathlib, sys, uuid
cache = pathlib.Path(os.environ["REBAR_CACHE"])
(cache / "deep").mkdir()
(cache / "deep" / "word").write_text(f"{sys.argv[1]} {uuid.uuid4().hex}")
(cache / "link").symlink_to("deep/word")
print("filled")
"""
READ = """\
import os, pathlib
cache = pathlib.Path(os.environ["REBAR_CACHE"])
print((cache / "link").read_text())
for path in (cache / "deep" / "word", cache / "new"):
    try:
        path.write_text("changed")
        print("WROTE", path.name)
    except OSError:
        pass
"""


@pytest.fixture(autouse=True)
def _own_caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))


def agent(folder: Path, name: str, prepare: str = PREPARE, **cache: Any) -> AgentSpec:
    """An agent whose cache a Python program fills, and whose sessions print what is in it."""
    home = folder / name
    home.mkdir(exist_ok=True)
    (home / "prepare.py").write_text(prepare)
    (home / "read.py").write_text(READ)
    manifest = {
        "name": name,
        "command": ["{python}", "read.py"],
        "pace": ["lockstep"],
        "cache": {"prepare": ["{python}", "prepare.py", name], **cache},
    }
    (home / f"{name}.yaml").write_text(yaml.safe_dump(manifest))
    return AgentSpec(manifest=str(home / f"{name}.yaml"))


def filled(spec: AgentSpec) -> tuple[str, AgentCache]:
    """What the cache holds, and what a result says of it."""
    with open_cache(*load_manifest(spec.manifest), spec) as cache:
        assert cache is not None
        return (cache.folder / "link").read_text(), cache.fact


@pytest.mark.parametrize("rung", EVERY)
@pytest.mark.process
def test_two_agents_read_two_caches_and_change_neither(tmp_path: Path, rung: str) -> None:
    """What a session prints is what the command wrote, once for several sessions."""
    with rung_or_skip(rung) as isolation:
        for name in ("first", "second"):
            spec = agent(tmp_path, name).model_copy(update={"isolation": isolation})
            word, fact = filled(spec)
            assert word.startswith(f"{name} ")
            assert (fact.files, fact.size_bytes) == (1, len(word))
            manifest, folder = load_manifest(spec.manifest)
            # The second session of one agent shows what the first has changed.
            for number in range(2 if name == "first" else 1):
                with open_cache(manifest, folder, spec) as cache:
                    assert cache is not None
                    scratch = tmp_path / f"{name}-{number}"
                    confined = manifest.model_copy(update={"isolation": isolation})
                    with open_agent(plan_of(confined, folder, scratch, cache=cache.folder)) as process:
                        exit_code(process)
                lines = process.output().decode().splitlines()
                # Without confinement nothing is kept from the agent, and the next line is its new word.
                assert lines[0] == (word if rung in CONFINING or number == 0 else "changed")
                assert len(lines) == (1 if rung in CONFINING else 3), lines


@pytest.mark.process
def test_what_changes_the_agent_fills_its_cache_again(tmp_path: Path) -> None:
    """The same digest for the same filling, another one after a change; the older goes once no session reads it."""
    spec = agent(tmp_path, "first")
    first = filled(spec)
    assert filled(spec) == first
    with open_cache(*load_manifest(spec.manifest), spec) as held:
        assert held is not None
        (tmp_path / "first" / "prepare.py").write_text(PREPARE + "# another program\n")
        second = filled(spec)
        assert second[0] != first[0]
        assert second[1].sha256 != first[1].sha256
        assert (held.folder / "link").read_text() == first[0]
    third = filled(spec.model_copy(update={"options": {"speed": 2}}))
    assert third[0] not in (first[0], second[0])
    assert not held.folder.exists()


FAILING: tuple[tuple[str, dict[str, Any], list[str]], ...] = (
    ("import sys; print('no \\x1b[2J compiler'); sys.exit(3)", {}, ["exit code 3", r"no \x1b[2J compiler"]),
    ("import time; print('begun'); time.sleep(600)", {"budget_s": 3.0}, ["longer than 3 s", "begun"]),
    (
        "import os; open(os.environ['REBAR_CACHE'] + '/big', 'wb').write(bytes(3 << 20))",
        {"size_mb": 2},
        ["more than 2 MB", "nothing"],
    ),
    ("import os; os.mkfifo(os.environ['REBAR_CACHE'] + '/pipe')", {}, ["pipe is neither a file"]),
)


@pytest.mark.process
def test_what_fails_is_told_with_what_it_printed(tmp_path: Path) -> None:
    """And after all of them the next try begins anew."""
    for prepare, limits, words in FAILING:
        with pytest.raises(SetupError) as refusal:
            filled(agent(tmp_path, "first", prepare, **limits))
        assert all(word in str(refusal.value) for word in words), refusal.value
    assert filled(agent(tmp_path, "first"))[0].startswith("first ")


@pytest.mark.process
def test_it_is_filled_on_a_network_of_its_own(tmp_path: Path) -> None:
    """A server of the host is out of its reach, where the host gives networks."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        spec = agent(tmp_path, "first", f"import socket; socket.create_connection(('127.0.0.1', {port}))")
        faults = cache_faults(spec)
    if not faults:
        pytest.skip("this host gives no networks")
    assert "refused" in faults[0].what


def test_a_campaign_is_refused_before_anything_is_placed(tmp_path: Path) -> None:
    """With one fault for each agent whose cache cannot be filled; a program that is missing is told without a try."""
    agents = [agent(tmp_path, name, f"raise SystemExit('no {name}')") for name in ("first", "second")]
    missing = agent(tmp_path, "third")
    (tmp_path / "third" / "prepare.py").unlink()
    assert "cache.prepare" in program_faults(*load_manifest(missing.manifest), {})[0].where
    base = load_simspec(EXAMPLE).model_copy(update={"vehicle": VehicleSpec(model="still")})
    campaign = Campaign(
        name="two", base=base, agents=tuple(CampaignAgent(manifest=one.manifest) for one in agents)
    )
    with pytest.raises(SetupError) as refusal:
        run_campaign_sync(
            campaign, tmp_path / "out", RunOptions(load_measurable_decomposition("search-and-report"))
        )
    assert [fault.where for fault in refusal.value.faults] == ["first: cache", "second: cache"]
    assert "it printed last: no first" in refusal.value.faults[0].what
    assert not (tmp_path / "out" / "simspecs").exists()


@pytest.mark.flight
def test_the_result_of_a_session_has_the_digest(tmp_path: Path) -> None:
    """That of the cache as it is filled; one whose cache fails is an invalid set-up, and has none."""
    nodes = load_measurable_decomposition("search-and-report")

    def flown(spec: AgentSpec, name: str) -> Any:
        scene = SimSpec(
            name="yard",
            world=World(area=AREA),
            vehicle=VehicleSpec(model="still"),
            agent=spec,
            mission=Mission(time_limit_s=1.0),
        )
        return fly_realization(scene, nodes, tmp_path / name, name)

    spec = agent(tmp_path, "first")
    assert flown(spec, "one").fact(AgentCache) == filled(spec)[1]
    assert (tmp_path / "one" / "agent.log").read_text().startswith(filled(spec)[0])
    failed = flown(agent(tmp_path, "second", "raise SystemExit('no compiler')"), "two")
    assert failed.outcome is Outcome.SETUP_INVALID
    assert "no compiler" in failed.reason
    assert failed.fact(AgentCache) is None
