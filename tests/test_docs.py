"""Every link between the pages leads to a page, and to a heading that the page has; every run that is named is one; and the site of them."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from bench.campaign import load_campaign, realizations, with_floor
from bench.contracts import plugins

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page
    for page in [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("docker/*.md"),
        *ROOT.glob("examples/**/*.md"),
        *ROOT.glob("tests/**/*.md"),
    ]
    # Of packages that npm has installed beside the example in Node.
    if "node_modules" not in page.parts
)


@cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors that a page's headings get from common Markdown renderers."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)


def broken_links(page: Path) -> list[str]:
    """Links of a page to files that do not exist, or to headings that their page does not have."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        goal = page.parent / path if path else page
        if not goal.exists() or (anchor and goal.suffix == ".md" and anchor not in anchors(goal.resolve())):
            broken.append(link)
    return broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    assert broken_links(page) == []


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# One thing\n")
    page = tmp_path / "page.md"
    page.write_text(
        "# Top\n[a](other.md#one-thing) [b](#top) [c](gone.md) [d](other.md#two-things) [e](#below)\n"
    )
    assert broken_links(page) == ["gone.md", "other.md#two-things", "#below"]


# `p017-r2-reference-naive`, and the folder of its campaign where one stands before it.
RUN_NAME = re.compile(r"(?:out/([a-z-]+)/runs/)?\b(p\d{3,}-r\d+-[a-z]+(?:-[a-z]+)*)")
CAMPAIGNS = {path.stem: path for path in sorted(ROOT.glob("campaigns/*.yaml"))}


@cache
def runs_of(campaign: str) -> frozenset[str]:
    """The runs of a shipped campaign by its file's name, with a floor where it can have one."""
    loaded = load_campaign(CAMPAIGNS[campaign])
    return frozenset(plan.id for plan in realizations(loaded if loaded.floor else with_floor(loaded)))


def named_runs(text: str) -> set[tuple[str, str]]:
    """The runs that a text names, each with the campaign in whose folder it says that they are."""
    return set(RUN_NAME.findall(text))


def is_flown(campaign: str, run: str, shipped: Iterable[str] = CAMPAIGNS) -> bool:
    """Whether a shipped campaign has this run; without one, whether any has the scene and the agent is a shipped one."""
    if campaign in CAMPAIGNS:
        return run in runs_of(campaign)
    scene, agent = re.fullmatch(r"(p\d+-r\d+-)(.*)", run).groups()  # type: ignore[union-attr]  # as in `RUN_NAME`
    # Looked for in one campaign after another: some take seconds to plan.
    is_scene = any(known.startswith(scene) for name in shipped for known in runs_of(name))
    return is_scene and agent in plugins("rebar.agents")


def test_the_runs_that_pages_and_help_texts_name_are_flown() -> None:
    """By the plans of the shipped campaigns: nothing is flown for this."""
    texts = {page: page.read_text() for page in [*PAGES, *ROOT.glob("bench/**/*.py")]}
    named = {run: path for path, text in texts.items() for run in named_runs(text)}
    assert {campaign for campaign, _ in named} >= {"", "demo"}
    assert {
        (path.name, run) for (campaign, run), path in named.items() if not is_flown(campaign, run)
    } == set()


def test_the_runs_of_a_text_are_found() -> None:
    text = "rebar score out/demo/runs/p000-r0-oracle, (`p017-r2-reference-naive`); p1-r1-x, map001-r1-x"
    assert named_runs(text) == {("demo", "p000-r0-oracle"), ("", "p017-r2-reference-naive")}
    assert not is_flown("demo", "p000-r0-oracle")
    assert not is_flown("", "p000-r0-oracle", ["demo", "rescue"])
    assert not is_flown("", "p017-r2-reference-brave")
    assert is_flown("demo", "p001-r1-reference-naive")
    assert not is_flown("demo", "p017-r2-reference-naive")
    assert is_flown("", "p017-r2-reference-naive")


def test_every_page_stands_in_the_site() -> None:
    """Where Sphinx is not installed, too: a page that no tree holds fails `make docs`."""
    index = ROOT / "docs" / "site" / "index.rst"
    held = {(index.parent / f"{line.strip()}.md").resolve() for line in index.read_text().splitlines()}
    pages = {
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docker/*.md"),
        *ROOT.glob("examples/*/*.md"),
    }
    assert pages - held == set()


MISSING = [name for name in ("furo", "myst_parser", "sphinx") if find_spec(name) is None]


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (make docs installs them)")
def test_the_site_is_whole(tmp_path: Path) -> None:
    """Built without a warning; it holds the public faces, and asks nobody for anything."""
    site = tmp_path / "site"
    command = "-m sphinx --builder html --fail-on-warning --keep-going --quiet --conf-dir docs/site ."
    line = [sys.executable, *command.split(), str(site)]
    built = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (built.returncode, built.stderr) == (0, "")
    assert "docs/site/index.html" in (site / "index.html").read_text()
    start = (site / "docs" / "site" / "index.html").read_text()
    # Every page is reached from the start.
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")):
        address = page.relative_to(ROOT).with_suffix(".html")
        assert (site / address).exists()
        assert f"../../{address}".replace("../../docs/", "../") in start
    names = re.findall(r'id="([\w.]+)"', (site / "docs" / "site" / "api.html").read_text())
    contracts = {"bench.contracts.Tape", "bench.contracts.Measure.__call__"}
    assert contracts | {"bench.streams.RosNode.publisher", "agent_adapters.client.open_bench"} <= {*names}
    for page in site.rglob("*.html"):
        assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="https?:[^"]*"', page.read_text()), page
