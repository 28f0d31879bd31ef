"""SimSpecs of a large campaign: read when asked for, and never all in memory."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from typing import Any

import pytest
from made_run import simspec

from bench.reporting._simspec_files import SimSpecFiles, situations_of
from bench.simspec import SimSpec


@pytest.fixture
def paths(tmp_path: Path) -> dict[str, Path]:
    """Twelve SimSpecs, one of them damaged and one gone."""
    paths = {f"p{number:03d}-r1-a": tmp_path / f"{number}.json" for number in range(12)}
    text = simspec().model_dump_json()
    for path in paths.values():
        path.write_text(text)
    paths["p003-r1-a"].write_text(text[: len(text) // 2])
    paths["p004-r1-a"].unlink()
    return paths


def test_no_more_are_kept_than_said(paths: dict[str, Path]) -> None:
    """Whatever is read, and however often; the others are read again."""
    files = SimSpecFiles(paths, kept=5)
    read = {name: weakref.ref(files[name]) for name in paths if files.get(name) is not None}
    gc.collect()
    alive = {name for name, reference in read.items() if reference() is not None}
    assert len(read) == 10
    assert len(alive) == 5
    assert all((files[name] is files[name]) is (name in alive) for name in read)
    assert all(files[name] == files[name] for name in read)


def test_damaged_and_missing_ones_are_none(paths: dict[str, Path]) -> None:
    files = SimSpecFiles(paths)
    for name in ("p003-r1-a", "p004-r1-a", "p099-r1-a"):
        assert files.get(name) is None
        with pytest.raises(KeyError):
            files[name]
    chosen = files.of(["p001-r1-a", "p000-r1-a", "p099-r1-a"])
    assert list(chosen) == ["p001-r1-a", "p000-r1-a"]
    assert [spec.name for spec in chosen.values()] == ["made", "made"]


def test_files_of_one_situation_are_read_once(tmp_path: Path) -> None:
    """They differ in name, agent and seeds; another fog is another situation, and only so many are kept."""
    paths: dict[str, Path] = {}
    for number in range(8):
        base = simspec()
        seeds = base.seeds.model_copy(update={"root": number})
        weather = base.environment.model_copy(update={"fog_level": float(number // 2)})
        changes = {"name": f"scene-{number}", "seeds": seeds, "environment": weather}
        spec = base.model_copy(update=changes)
        paths[f"p{number:03d}"] = tmp_path / f"{number}.json"
        paths[f"p{number:03d}"].write_text(spec.model_dump_json())
    files = SimSpecFiles(paths, kept=3)
    fogs = {name: files[name].environment.fog_level for name in paths}
    for path in (*list(paths.values())[:6], paths["p007"]):
        path.unlink()
    files = files.of(list(paths)[:7])
    # The fourth situation is not kept, so the file is read again.
    situations = dict(situations_of(files))
    read = {name: spec.environment.fog_level for name, spec in situations.items()}
    assert read == {name: fogs[name] for name in list(paths)[:7]}
    assert situations["p000"] is situations["p001"]
    assert situations["p000"] is not situations["p002"]
    assert dict(situations_of({"a": simspec()})) == {"a": simspec()}


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("environment", {"fog_level": 5.0}),
        ("rules", {"max_altitude_m": 90.0}),
        ("mission", {"time_limit_s": 321.0}),
        ("perception", {"source": "agent"}),
        ("vehicle", {"autopilot": "ardupilot"}),
        ("pace", {"tick_s": 0.5}),
    ],
)
def test_every_part_of_a_situation_tells_it_apart(tmp_path: Path, part: str, value: dict[str, Any]) -> None:
    document = simspec().model_dump(mode="json")
    other = {**document, part: {**document[part], **value}}
    specs = {"a": SimSpec.model_validate(document), "b": SimSpec.model_validate(other)}
    for name, spec in specs.items():
        (tmp_path / name).write_text(spec.model_dump_json())
    files = SimSpecFiles({name: tmp_path / name for name in specs})
    for name, spec in specs.items():
        assert files[name] == files.situation(name) == spec
