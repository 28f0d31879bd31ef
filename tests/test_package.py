"""What the distribution says about the Pythons that it works on, and what can be checked with one of them alone."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
FLOWN = ("3.11.7", "3.12.1", "3.13.0")
"""Those on which examples/search.yaml and examples/rescue.yaml were flown, with equal messages. Fly both before a line is
added here: `bench.recording.recording_difference` names nothing but the versions then.
"""
# "What's New in Python" 3.12, 3.13 and 3.14, their sections on removed modules.
REMOVED = frozenset(
    [
        "asynchat",
        "asyncore",
        "distutils",
        "imp",
        "smtpd",
        "aifc",
        "audioop",
        "cgi",
        "cgitb",
        "chunk",
        "crypt",
        "imghdr",
        "lib2to3",
        "mailcap",
        "msilib",
        "nis",
        "nntplib",
        "ossaudiodev",
        "pipes",
        "sndhdr",
        "spwd",
        "sunau",
        "telnetlib",
        "uu",
        "xdrlib",
    ]
)


def project() -> dict[str, object]:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    document: dict[str, dict[str, object]] = tomllib.loads(text)
    return document["project"]


def pins() -> list[Requirement]:
    """The pinned distributions of requirements.lock, with their markers."""
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    return [Requirement(line.rstrip("\\ ")) for line in lines if line and line[0] not in " #"]


def test_classifiers_and_pages_name_the_pythons_that_were_tried() -> None:
    """Classifiers say what was flown, and no more; what is newer may be installed, and the pages say that it was not tried."""
    classifiers = project()["classifiers"]
    assert isinstance(classifiers, list)
    prefix = "Programming Language :: Python :: 3."
    classified = [name.removeprefix(prefix) for name in classifiers if name.startswith(prefix)]
    assert classified == [version.split(".")[1] for version in FLOWN]
    stated = f"{', '.join(FLOWN[:-1])} and {FLOWN[-1]}"
    for page in ("README.md", "docs/scope.md"):
        assert stated in (ROOT / page).read_text(encoding="utf-8"), page
    allowed = SpecifierSet(str(project()["requires-python"]))
    assert [version in allowed for version in ("3.10", *PYTHONS)] == [False, True, True, True, True]


@pytest.mark.parametrize("version", PYTHONS)
def test_the_lock_has_one_version_of_every_dependency_for_every_python(version: str) -> None:
    """A universal lock may pin two versions of a package; on one Python exactly one of them applies."""
    environment = {"python_version": version, "python_full_version": f"{version}.1"}
    environment |= {"sys_platform": "linux", "platform_system": "Linux", "os_name": "posix"}
    applying = [pin for pin in pins() if pin.marker is None or pin.marker.evaluate(environment)]
    names = [pin.name for pin in applying]
    assert len(names) == len(set(names)) > 40
    locked = {pin.name: str(pin.specifier).removeprefix("==") for pin in applying}
    dependencies = project()["dependencies"]
    assert isinstance(dependencies, list)
    for dependency in map(Requirement, dependencies):
        assert locked[dependency.name] in dependency.specifier


def test_no_module_is_imported_that_a_later_python_lacks() -> None:
    packages = ("bench", "vehicle_models", "test_ports", "agent_adapters", "decompositions")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    assert len(files) > 400
    # By line, which finds them as surely as a parser in code that ruff formats, and takes a hundredth of its time.
    statement = re.compile(rf"^\s*(?:import|from) ({'|'.join(REMOVED)})\b", re.MULTILINE)
    assert statement.search("x = 1\n    import telnetlib\n")
    assert not [path for path in files if statement.search(path.read_text(encoding="utf-8"))]
