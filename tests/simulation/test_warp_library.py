"""The library for warp is built when it is first needed, and refused in a sentence where it cannot be."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from bench.errors import SetupError
from bench.process_threads import ProcessThreads
from bench.simulation.warp import _library
from bench.simulation.warp._library import built_library
from bench.simulation.warp._programs import UNENTERED_S, Programs, unreachable_reason

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="warp is for Linux with glibc")


def compiler(folder: Path, text: str) -> None:
    """A program `cc` that finds `OUT` in its arguments."""
    folder.mkdir(exist_ok=True)
    program = folder / "cc"
    program.write_text(
        '#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done\nOUT=$2\necho run >> "$0.log"\n' + text
    )
    program.chmod(0o755)


def test_two_who_need_it_at_once_get_one_whole_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compiler that writes its file in two parts: nobody sees the first alone, and nothing else is left."""
    compiler(tmp_path / "bin", 'printf half > "$OUT"\nsleep 0.05\nprintf whole >> "$OUT"\n')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")

    def content(_: int) -> tuple[Path, str]:
        library = built_library(tmp_path / "cache")
        return library, library.read_text()

    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(content, range(4))
    assert first[1] == "halfwhole"
    assert set(others) == {first}
    assert list((tmp_path / "cache").iterdir()) == [first[0]]
    runs = (tmp_path / "bin" / "cc.log").read_text()
    built_library(tmp_path / "cache")
    assert (tmp_path / "bin" / "cc.log").read_text() == runs


def test_whatever_changes_the_library_gets_a_library_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another compiler, one that was updated in its place, other flags and another source."""
    source = tmp_path / "preload.c"
    source.write_text("int other;")
    libraries = []
    for name, text, changes in (
        ("a", "", {}),
        ("b", "", {}),
        ("a", "# updated", {}),
        ("a", None, {"FLAGS": ("-O3",)}),
        ("a", None, {"SOURCE": source}),
    ):
        if text is not None:
            compiler(tmp_path / name, f'printf made > "$OUT"\n{text}')
        monkeypatch.setenv("PATH", f"{tmp_path / name}:/usr/bin:/bin")
        with monkeypatch.context() as patched:
            for attribute, value in changes.items():
                patched.setattr(_library, attribute, value)
            libraries.append(built_library(tmp_path / "cache"))
            assert built_library(tmp_path / "cache") == libraries[-1]
    assert len(set(libraries)) == 5


def test_without_a_compiler_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SetupError, match=r"pace\.mode.*no.*compiler|needs a C compiler.*install gcc"):
        built_library(tmp_path / "cache")


def test_a_compiler_that_fails_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler(tmp_path / "bin", 'echo "preload.c:9: error: no such header" >&2\nexit 1\n')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    with pytest.raises(SetupError, match=r"no such header.*headers"):
        built_library(tmp_path / "cache")
    assert not list((tmp_path / "cache").iterdir())


def changed(program: Path, old: bytes, new: bytes) -> Path:
    program.write_bytes(program.read_bytes().replace(old, new, 1))
    return program


def test_programs_that_the_library_cannot_reach_are_known_by_their_file(tmp_path: Path) -> None:
    """An ordinary program, the same without an interpreter, the same with a section of Go's, a script, nothing at all."""
    ordinary = Path(shutil.which("true") or "/bin/true").resolve()
    assert unreachable_reason(ordinary) == ""
    # A program header of type PT_INTERP (3), readable (4), becomes one of type PT_NULL.
    static = changed(Path(shutil.copy(ordinary, tmp_path / "static")), b"\3\0\0\0\4\0\0\0", bytes(8))
    assert "statically linked" in unreachable_reason(static)
    go = changed(Path(shutil.copy(ordinary, tmp_path / "go")), b".gnu_debuglink\0", b".gopclntab\0\0\0\0\0")
    assert "Go program" in unreachable_reason(go)
    script = tmp_path / "script"
    script.write_text("#!/bin/sh\n")
    assert unreachable_reason(script) == ""
    assert unreachable_reason(tmp_path / "missing") == ""
    assert os.path.exists(ordinary)


@pytest.mark.process
def test_a_program_that_has_ended_is_no_program_without_the_library() -> None:
    """Two are followed and seen without it long ago; the one that has ended meanwhile, and that nobody has reaped, is not
    refused for it.
    """
    with (
        subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as living,
        subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as ended,
    ):
        try:
            refusals = {}
            for process in (living, ended):
                # Once it has answered it is loaded: until then it may rest for a moment, and go on.
                assert process.stdin
                assert process.stdout
                process.stdin.write(b"?")
                process.stdin.flush()
                assert process.stdout.read(1) == b"?"
                with closing(ProcessThreads(process.pid, root_is_box=False, with_bench=False)) as threads:
                    threads.scan()
                    programs, (followed,) = Programs(threads), threads.processes.values()
                    assert programs.unentered(set()) == [followed]
                    while not programs.refusal(followed, 0.0) and not followed.threads[process.pid].rests():
                        os.sched_yield()
                    followed.unentered_since_s = 0.0
                    if process is ended:
                        process.kill()
                        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
                    refusals[process.pid] = programs.refusal(followed, UNENTERED_S + 1.0)
        finally:
            living.kill()
            ended.kill()
    assert "runs without the library for warp" in refusals[living.pid]
    assert refusals[ended.pid] == ""
