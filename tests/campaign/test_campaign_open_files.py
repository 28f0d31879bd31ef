"""A limit of open files under which no session could fly is told before the first one, or raised where it is soft."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
from campaign_fakes import Script, fly, small_campaign

from bench.campaign import open_local_pool
from bench.campaign.execution import _local_pool
from bench.campaign.execution._local_pool import FILES_OF_A_SESSION
from bench.cli._app import run
from bench.errors import SetupError

SIMSPEC = Path(__file__).parents[2] / "examples" / "search.yaml"
FREE = resource.RLIM_INFINITY


class Limit:
    """The limit of open files of this process, as soft and hard; setting it changes nothing else."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, soft: int, hard: int) -> None:
        self.value = (soft, hard)
        monkeypatch.setattr(resource, "getrlimit", lambda _: self.value)
        monkeypatch.setattr(resource, "setrlimit", lambda _, value: setattr(self, "value", value))


def test_a_hard_limit_that_is_too_low_ends_a_campaign_before_its_first_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Limit(monkeypatch, 32, 32)
    with pytest.raises(SetupError) as error:
        fly(tmp_path, small_campaign(points=1), Script(), open_executor=open_local_pool)
    (fault,) = error.value.faults
    assert fault.what == "32 open files are allowed (ulimit -Hn), and 128 are needed for sessions at once: 1"
    assert "ulimit -n 128" in fault.remedy
    assert "--workers" not in fault.remedy, "fewer than one is none"
    assert not (tmp_path / "runs").exists()


def test_a_session_alone_says_it_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Limit(monkeypatch, 32, 32)
    assert run(["simulate", str(SIMSPEC), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("rebar: workers: 32 open files are allowed")


@pytest.mark.parametrize(
    ("limit", "workers", "expected"),
    [
        ((FILES_OF_A_SESSION, FILES_OF_A_SESSION), 1, (FILES_OF_A_SESSION, FILES_OF_A_SESSION)),
        ((FILES_OF_A_SESSION, FILES_OF_A_SESSION), 16, (FILES_OF_A_SESSION, FILES_OF_A_SESSION)),
        ((32, FILES_OF_A_SESSION), 16, (FILES_OF_A_SESSION, FILES_OF_A_SESSION)),
        ((32, FREE), 17, (132, FREE)),
        ((1024, 4096), 300, (1264, 4096)),
        ((1024, 4096), 8, (1024, 4096)),
        ((FREE, FREE), 300, (FREE, FREE)),
        ((FILES_OF_A_SESSION - 1, FILES_OF_A_SESSION - 1), 1, None),
        ((FILES_OF_A_SESSION, FILES_OF_A_SESSION), 17, None),
    ],
)
def test_a_soft_limit_is_raised_as_far_as_the_workers_need(
    limit: tuple[int, int], workers: int, expected: tuple[int, int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = Limit(monkeypatch, *limit)
    if expected is None:
        with pytest.raises(SetupError, match="open files are allowed") as error:
            _local_pool._allow_open_files(workers)
        assert ("--workers" in str(error.value)) is (workers > 1)
        assert now.value == limit
    else:
        _local_pool._allow_open_files(workers)
        assert now.value == expected
