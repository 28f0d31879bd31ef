"""`rebar docs`: pages, and the links and pictures on them, in a checkout and as a wheel has them."""

from __future__ import annotations

import shutil
import webbrowser
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from command_line import Rebar

from bench.cli._docs import TOP_PAGES, write_pages

ROOT = Path(__file__).parents[2]


class PageReader(HTMLParser):
    """The targets of a page, its anchors, and the texts of links that lead nowhere."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = set()
        self.dead = 0
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.targets += [str(found[name]) for name in ("href", "src") if name in found]
        self.anchors |= {str(found["id"])} if "id" in found else set()
        self.dead += tag in ("a", "img") and not found.keys() & {"href", "src"}


def faults_of(folder: Path) -> list[str]:
    """Links of written pages that lead to no file, or to no heading of it."""
    pages = {page.resolve(): PageReader(page) for page in folder.rglob("*.html")}
    faults = []
    for page, read in pages.items():
        for target in read.targets:
            parts = urlsplit(target)
            if parts.scheme in ("http", "https", "mailto"):
                continue
            goal = Path(unquote(parts.path)) if parts.scheme == "file" else page.parent / unquote(parts.path)
            goal = goal.resolve() if parts.path else page
            is_page = bool(parts.fragment) and goal in pages
            is_there = parts.fragment in pages[goal].anchors if is_page else goal.exists()
            faults += [] if is_there else [f"{page.name}: {target}"]
    return faults


def test_every_link_of_every_page_leads_somewhere(tmp_path: Path) -> None:
    """Pages to written pages, all else to the files where they lie; nothing of a checkout is left out."""
    write_pages(ROOT, tmp_path)
    written = {page.relative_to(tmp_path).with_suffix(".md") for page in tmp_path.rglob("*.html")}
    sources = {*(ROOT / "docs").glob("*.md"), *(ROOT / name for name in TOP_PAGES)}
    assert written == {source.relative_to(ROOT) for source in sources}
    assert faults_of(tmp_path) == []
    assert not any(PageReader(page).dead for page in tmp_path.rglob("*.html"))
    agents = PageReader(tmp_path / "docs" / "agents.html").targets
    assert any(target.startswith("agents-protocol.html#") for target in agents)


def test_in_a_wheel_a_link_to_what_is_not_there_is_text(tmp_path: Path) -> None:
    """With the files that the wheel has and no others; the words of such a link remain."""
    root = tmp_path / "shipped"
    for folder in ("docs", "examples", "campaigns"):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("node_modules"))
    for name in TOP_PAGES:
        shutil.copyfile(ROOT / name, root / name)
    write_pages(root, tmp_path / "written")
    assert faults_of(tmp_path / "written") == []
    index = (tmp_path / "written" / "docs" / "README.html").read_text(encoding="utf-8")
    assert "<a>docker/</a>" in index
    assert '<a href="../CONTRIBUTING.html">CONTRIBUTING</a>' in index


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    """The test above can fail: a page that is not there, and a heading that is not on it."""
    links = '<a href="c.html"><a href="b.html#here"><a href="b.html#there">'
    (tmp_path / "a.html").write_text(links, encoding="utf-8")
    (tmp_path / "b.html").write_text('<p id="here">', encoding="utf-8")
    assert faults_of(tmp_path) == ["a.html: c.html", "a.html: b.html#there"]


def test_a_page_opens_where_there_is_a_display(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    """Its path is printed in any case; `--path` opens nothing, and neither does a terminal without a display."""
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for display, words, file in (
        ("", ["--path"], "README"),
        ("", ["time.md"], "time"),
        (":0", ["simspec", "--path"], "simspec"),
        (":0", ["simspec"], "simspec"),
        (":0", [], "README"),
    ):
        monkeypatch.delenv("DISPLAY", raising=False)
        if display:
            monkeypatch.setenv("DISPLAY", display)
        opened.clear()
        printed = Path(rebar("docs", *words).strip())
        assert printed == tmp_path / "rebar" / "docs" / "docs" / f"{file}.html"
        assert printed.is_file()
        assert opened == ([printed.as_uri()] if display and "--path" not in words else [])


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("simspek", "there is no page 'simspek' (did you mean simspec? There are README, agents, "),
        ("xyzzy", "there is no page 'xyzzy' (there are README, agents, "),
        ("../README", "there is no page '../README'"),
    ],
)
def test_an_unknown_page_is_told(page: str, words: str, rebar: Rebar) -> None:
    told = rebar.refused("docs", page)
    assert words in told
    assert all(path.stem in told for path in (ROOT / "docs").glob("*.md"))
