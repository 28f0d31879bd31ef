"""Commands called in this process, and a campaign that is flown in seconds."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.cli._app import run

EXAMPLE = Path(__file__).parents[1] / "examples" / "search.yaml"
CAMPAIGN = """
format: rebar.campaign/1
name: short
base_file: scene.yaml
agents: [{manifest: reference-naive}]
design:
  seed: 3
  method: {kind: full_factorial}
  factors:
    - {name: concealment, levels: [0.5, 1.0], sets: ['actors[radar].concealment']}
"""
FOG = {"name": "fog", "levels": [0, 1, 2], "sets": ["environment.fog_level"]}
CONCEALMENT = {"name": "concealment", "levels": [0.5, 1.0], "sets": ["actors[radar].concealment"]}
SURROGATES: dict[str, Any] = {
    "format": "rebar.campaign/1",
    "name": "surrogates",
    "base_file": str(EXAMPLE),
    "fidelity": "overhead",
    "agents": [{"manifest": "reference-naive"}, {"manifest": "reference-bystander-aware"}],
    "design": {"seed": 3, "factors": [CONCEALMENT, FOG]},
}
"""A campaign that is flown in less than a second."""


def json_of(line: list[str], capsys: pytest.CaptureFixture[str], code: int = 0) -> Any:
    """What a command prints for a machine, which ends with this code."""
    capsys.readouterr()
    assert run(line) == code
    return json.loads(capsys.readouterr().out)


@dataclass(frozen=True)
class Rebar:
    """Commands that print for the test; their words may be anything that has a text."""

    capsys: pytest.CaptureFixture[str]

    def __call__(self, *words: object, code: int = 0) -> str:
        """What a command prints, which ends with this code."""
        return self._ended(words, code)[0]

    def words(self, *words: object, code: int = 0) -> str:
        """The same with a space wherever a line may be wrapped."""
        return " ".join(self(*words, code=code).split())

    def refused(self, *words: object, code: int = 2) -> str:
        """What a command prints as an error."""
        error = self._ended(words, code)[1]
        assert "Traceback" not in error
        return error

    def json(self, *words: object, code: int = 0) -> Any:
        """What a command prints for a machine."""
        return json.loads(self(*words, "--json", code=code))

    def _ended(self, words: tuple[object, ...], code: int) -> tuple[str, str]:
        self.capsys.readouterr()
        ended = run([str(word) for word in words])
        shown = self.capsys.readouterr()
        assert ended == code, shown
        return shown.out, shown.err


@pytest.fixture
def rebar(capsys: pytest.CaptureFixture[str]) -> Rebar:
    return Rebar(capsys)


def short_campaign(folder: Path, more: str = "", time_limit_s: float = 10.0) -> Path:
    """The file of a campaign of two scenes that run out of time after some simulated seconds."""
    scene = EXAMPLE.read_text()
    assert "time_limit_s: 300.0" in scene
    (folder / "scene.yaml").write_text(scene.replace("time_limit_s: 300.0", f"time_limit_s: {time_limit_s}"))
    file = folder / "short.yaml"
    file.write_text(CAMPAIGN + more)
    return file


def fly_short(folder: Path, more: str = "", time_limit_s: float = 10.0) -> Path:
    """The folder of such a campaign that was flown."""
    line = ["run", str(short_campaign(folder, more, time_limit_s)), "--out", str(folder / "out")]
    assert run([*line, "--workers", "1"]) == 0
    return folder / "out"


def fly_surrogates(folder: Path, **changes: object) -> Path:
    """The folder of a campaign of surrogates, with other fields than usual, that was flown."""
    (folder / "campaign.yaml").write_text(yaml.safe_dump(SURROGATES | changes))
    assert run(["run", str(folder / "campaign.yaml"), "--out", str(folder / "out"), "--workers", "1"]) == 0
    return folder / "out"
