"""The Dockerfile: its structure, and in `make slow` its steps, run without a container."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
USER = 10001
"""An id that no account on the test machine has, as `--user` may bring one."""


@dataclass(frozen=True)
class Instruction:
    """One instruction of a Dockerfile, its continued lines joined."""

    name: str
    text: str

    @property
    def arguments(self) -> list[str]:
        """The words, or the entries of a JSON list."""
        return list(json.loads(self.text)) if self.text.startswith("[") else shlex.split(self.text)


def parsed() -> list[list[Instruction]]:
    """The stages of the Dockerfile; before the first FROM a list of its arguments."""
    text = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    stages: list[list[Instruction]] = [[]]
    for line in "\n".join(lines).replace("\\\n", " ").splitlines():
        name, _, rest = line.partition(" ")
        if name == "FROM":
            stages.append([])
        stages[-1].append(Instruction(name, rest.strip()))
    return stages


def named(stage: list[Instruction], name: str) -> list[Instruction]:
    return [instruction for instruction in stage if instruction.name == name]


def environment(stage: list[Instruction]) -> dict[str, str]:
    pairs = [word.partition("=") for instruction in named(stage, "ENV") for word in instruction.arguments]
    return {name: value for name, _, value in pairs}


def test_both_stages_stand_on_one_exact_version() -> None:
    head, *stages = parsed()
    (argument,) = named(head, "ARG")
    name, _, base = argument.text.partition("=")
    # A version with all three numbers, or a digest.
    assert re.search(r":\d+\.\d+\.\d+-|@sha256:[0-9a-f]{64}$", base)
    assert [stage[0].text for stage in stages] == [f"${{{name}}} AS build", f"${{{name}}}"]
    assert f"{base}@sha256:" in (ROOT / "docker" / "README.md").read_text(encoding="utf-8")


def test_what_is_copied_is_there_and_is_all_that_the_wheel_needs() -> None:
    """Nothing that .dockerignore leaves out, every package of the wheel, and no source in the second stage."""
    _, build, run = parsed()
    sources = [source for copy in named(build, "COPY") for source in copy.arguments[:-1]]
    assert all((ROOT / source).exists() for source in sources)
    ignored = {line.strip("/") for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()}
    assert not ignored & set(sources)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    files = [project["project"]["readme"], *project["project"]["license-files"]]
    files += ["pyproject.toml", "requirements.lock"]
    assert {*wheel["packages"], *wheel["force-include"], *files} <= set(sources)
    assert [copy.arguments for copy in named(run, "COPY")] == [["--from=build", "/opt/rebar", "/opt/rebar"]]


def test_it_runs_as_nobody_in_particular() -> None:
    """Not as root, by number, after the last step that needs root; HOME and caches where any id may write."""
    _, _, run = parsed()
    names = [instruction.name for instruction in run]
    (user,) = named(run, "USER")
    assert all(int(part) > 0 for part in user.text.split(":"))
    assert names.index("USER") > max(index for index, name in enumerate(names) if name in ("RUN", "COPY"))
    variables = environment(run)
    assert variables["HOME"] == "/tmp"
    assert variables["XDG_CACHE_HOME"].startswith("/tmp/")
    assert named(run, "WORKDIR")[0].text in named(run, "RUN")[0].text
    assert "chmod 1777" in named(run, "RUN")[0].text
    (entrypoint,) = named(run, "ENTRYPOINT")
    (health,) = named(run, "HEALTHCHECK")
    assert entrypoint.arguments == ["rebar"]
    assert json.loads(health.text.partition("CMD ")[2])[0] == "rebar"


@contextmanager
def image_root() -> Iterator[Path]:
    """A folder in place of `/`, that every user may enter: those of pytest are its own user's."""
    folder = Path(tempfile.mkdtemp(prefix="rebar-image-"))
    try:
        folder.chmod(0o755)
        yield folder
    finally:
        shutil.rmtree(folder)


def interpreter() -> tuple[Path, bool]:
    """A Python for the build stage, and whether other users may run it: one in root's home they may not."""
    for candidate in (Path(sys.executable).resolve(), Path("/usr/bin/python3").resolve()):
        if all(folder.stat().st_mode & 0o001 for folder in candidate.parents):
            return candidate, True
    return Path(sys.executable).resolve(), False


def moved(text: str, root: Path) -> str:
    """The same with the image's folders under `root`; /tmp is the machine's."""
    return re.sub(r"(?<![\w.])/(opt|src|work)\b", rf"{root}/\1", text)


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.timeout(3600)
def test_its_steps_build_an_installation_that_another_user_runs() -> None:
    """Every RUN of both stages, then the entry point and the health check: ten seconds of the example,
    flown into a folder that every user may write to, outside the checkout.
    """
    _, build, run = parsed()
    with image_root() as root:
        python, is_for_all = interpreter()
        (root / "bin").mkdir()
        (root / "bin" / "python").symlink_to(python)
        path = f"{root / 'bin'}:{os.environ['PATH']}"
        for stage in (build, run):
            variables = {"PATH": path, "HOME": str(root), **environment(stage)} | {"PATH": path}
            for instruction in stage:
                at = root / "src" if stage is build else root
                at.mkdir(exist_ok=True)
                match instruction.name:
                    case "COPY" if stage is build:
                        *sources, target = instruction.arguments
                        for source in sources:
                            _copy(ROOT / source, at / target)
                    case "RUN":
                        command = ["sh", "-ec", moved(instruction.text, root)]
                        subprocess.run(command, cwd=at, env=variables, check=True)
        shutil.rmtree(root / "src")

        variables = {name: moved(value, root) for name, value in environment(run).items()}
        variables["PATH"] = variables["PATH"].replace("$PATH", "/usr/bin:/bin")
        may_change = os.geteuid() == 0 and is_for_all
        identity = {"user": USER, "group": USER, "extra_groups": []} if may_change else {}

        def rebar(*arguments: str) -> str:
            ended = subprocess.run(
                arguments, cwd=root / "work", env=variables, capture_output=True, text=True, **identity
            )  # type: ignore[call-overload]
            assert ended.returncode == 0, ended.stderr
            return str(ended.stdout)

        (entrypoint,) = named(run, "ENTRYPOINT")
        (health,) = named(run, "HEALTHCHECK")
        assert rebar(*json.loads(health.text.partition("CMD ")[2])).startswith("rebar ")
        assert "Usage" in rebar(*entrypoint.arguments, *named(run, "CMD")[0].arguments)
        rebar(*entrypoint.arguments, "examples", "--copy", "mine")
        scene = root / "work" / "mine" / "examples" / "search.yaml"
        text = scene.read_text(encoding="utf-8").replace("time_limit_s: 300.0", "time_limit_s: 10.0")
        scene.write_text(text, encoding="utf-8")
        shown = rebar(*entrypoint.arguments, "simulate", "mine/examples/search.yaml", "--out", "first")
        assert "completed after" in shown, shown
        owner = (root / "work" / "first" / "recording.mcap").stat().st_uid
        assert owner == (USER if identity else os.geteuid())


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    else:
        shutil.copy(source, target)
