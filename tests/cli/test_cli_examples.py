"""What comes with the distribution: listed, copied, and run from an installed wheel outside the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
import yaml
from command_line import Rebar

from bench.campaign import load_campaign
from bench.simspec import load_simspec

ROOT = Path(__file__).parents[2]


def test_every_file_is_listed_and_copied(tmp_path: Path, rebar: Rebar) -> None:
    """Every campaign, decomposition and example of the project; the campaigns and SimSpecs load where they lie."""
    listed = set(rebar("examples").splitlines())
    wanted = {
        *(f"campaigns/{path.relative_to(ROOT / 'campaigns')}" for path in ROOT.glob("campaigns/**/*.yaml")),
        *(f"decompositions/{path.name}" for path in ROOT.glob("decompositions/data/*.yaml")),
        *(f"examples/{path.relative_to(ROOT / 'examples')}" for path in ROOT.glob("examples/**/*.yaml")),
        *(f"examples/mqtt/{name}" for name in ("mqtt_agent.py", "mqtt_agent.js", "package.json")),
    }
    # What npm has installed beside the example in Node, where somebody has flown it.
    wanted = {name for name in wanted if "node_modules" not in name}
    assert wanted <= listed
    assert not any("node_modules" in name for name in listed)
    mine = tmp_path / "mine"
    rebar("examples", "--copy", mine)
    assert all((mine / name).is_file() for name in wanted)
    for campaign in ("demo", "full", "paper", "rescue", "standard", "standard_2"):
        load_campaign(mine / "campaigns" / f"{campaign}.yaml")
    for simspec in ("search", "rescue", "governed", "patrol"):
        load_simspec(mine / "examples" / f"{simspec}.yaml")


def test_a_copy_overwrites_nothing(tmp_path: Path, rebar: Rebar) -> None:
    (tmp_path / "campaigns").mkdir()
    for name in ("demo", "paper"):
        (tmp_path / "campaigns" / f"{name}.yaml").write_text("mine", encoding="utf-8")
    told = rebar.refused("examples", "--copy", tmp_path)
    assert all(f"{name}.yaml: this file exists" in told for name in ("demo", "paper"))
    assert (tmp_path / "campaigns" / "demo.yaml").read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "examples").exists()


# Building and a session are half a minute of a core, which a busy host may stretch beyond the usual limit.
@pytest.mark.timeout(900)
def test_an_installed_wheel_runs_a_campaign_outside_the_checkout(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = ["wheel", "--no-build-isolation", "--no-deps", "--wheel-dir", str(tmp_path), str(ROOT)]
    subprocess.run([*pip, *build], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    # Every file of every package is in it, so a short flight is enough to show that it runs.
    packages_of_ours = ("bench", "vehicle_models", "test_ports", "agent_adapters", "decompositions")
    files = [path for package in packages_of_ours for path in (ROOT / package).rglob("*") if path.is_file()]
    # The sources of bench/view/static/app.js, and what npm installs beside them, are not for users.
    sources = ROOT / "bench" / "view" / "app"
    wanted = {
        f"{path.relative_to(ROOT)}"
        for path in files
        if "__pycache__" not in path.parts and sources not in path.parents
    }
    assert len(wanted) > 500
    assert not [name for name in names if name.startswith("bench/view/app/")]
    assert wanted - set(names) == set()
    assert not [name for name in names if name.startswith("tests/") or name.endswith(".pyc")]
    # The dependencies are those of this environment: paths in a .pth file bring modules, and no other .pth file.
    home = tmp_path / "venv"
    venv.create(home, with_pip=False)
    (packages,) = home.glob("lib/python*/site-packages")
    others = [path for path in sys.path if path.endswith("site-packages")]
    (packages / "dependencies.pth").write_text("\n".join(others), encoding="utf-8")
    python = str(home / "bin" / "python")
    # What is used is compiled when it is first imported: a third of the modules.
    install = ["install", "--no-compile", "--no-deps", "--no-index", "--ignore-installed", str(wheel)]
    subprocess.run([*pip, "--python", python, *install], check=True, capture_output=True)

    def installed(*arguments: str) -> str:
        environment = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
        environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
        command = [str(home / "bin" / "rebar"), *arguments]
        ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    where = subprocess.run(
        [python, "-c", "import bench; print(bench.__file__)"], cwd=tmp_path, capture_output=True
    )
    assert str(packages).encode() in where.stdout
    assert installed("--version").startswith("rebar ")
    pages = {f"bench/cli/shipped/docs/{path.name}" for path in (ROOT / "docs").glob("*.md")}
    assert pages | {"bench/cli/shipped/README.md", "bench/cli/shipped/CONTRIBUTING.md"} <= set(names)
    written = Path(installed("docs", "mqtt-agents", "--path").strip())
    assert "<h1" in written.read_text(encoding="utf-8")
    assert written.with_name("simspec.html").is_file()
    installed("examples", "--copy", "mine")
    file = tmp_path / "mine" / "campaigns" / "demo.yaml"
    campaign = yaml.safe_load(file.read_text(encoding="utf-8"))
    campaign["design"]["method"]["take"] = 1
    del campaign["agents"][1:]
    # It turns for home in time: an early end of the mission is an end of it too.
    campaign["base"]["mission"]["time_limit_s"] = 60.0
    file.write_text(yaml.safe_dump(campaign), encoding="utf-8")
    assert "1 completed" in installed("run", str(file), "--out", "out")
    assert "all files match" in installed("verify", "out")
