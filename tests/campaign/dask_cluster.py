"""A Dask scheduler that cannot import the bench, and worker processes, as a cluster has them; and jobs for its workers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from bench.contracts import SessionResult
from bench.simspec import SimSpec

# None in place of a module makes its import fail, also for what is unpickled.
_SCHEDULER = """
import sys
sys.modules["bench"] = sys.modules["decompositions"] = None
from distributed.cli.dask_scheduler import main
main(["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter"])
"""
_WORKER = """
import sys
from distributed.cli.dask_worker import main
main([sys.argv[1], "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"])
"""
MARKS = "REBAR_TEST_MARKS"


class DaskCluster:
    """A scheduler and its workers, all processes of their own."""

    def __init__(self, marks: Path, repeats: int = 0) -> None:
        # Killed workers remove nothing.
        temporary = marks / "temporary"
        temporary.mkdir(exist_ok=True)
        self._environment = {
            **os.environ,
            "TMPDIR": str(temporary),
            "PYTHONPATH": str(Path(__file__).parent),
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(repeats),
            MARKS: str(marks),
        }
        self.scheduler = self._started(_SCHEDULER)
        self.address = _word_after(self.scheduler.stderr, "Scheduler at:")
        self.workers: list[subprocess.Popen[str]] = []

    def add_worker(self) -> None:
        """Start a worker with one thread."""
        self.workers.append(self._started(_WORKER, self.address))

    def close(self) -> None:
        """Kill all of its processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.communicate()

    def _started(self, code: str, *arguments: str) -> subprocess.Popen[str]:
        # A file for what workers write: nobody reads a pipe of theirs.
        output = subprocess.DEVNULL if arguments else subprocess.PIPE
        return subprocess.Popen(
            [sys.executable, "-c", code, *arguments], env=self._environment, stderr=output, text=True
        )


@contextmanager
def open_cluster(marks: Path, workers: int = 2, repeats: int = 0) -> Iterator[DaskCluster]:
    """Yield a cluster whose jobs find the folder `marks`."""
    cluster = DaskCluster(marks, repeats)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        cluster.close()


def _word_after(lines: IO[str] | None, mark: str) -> str:
    assert lines is not None
    for line in lines:
        if mark in line:
            return line.split(mark)[1].split()[0]
    raise AssertionError(f"the scheduler ended without {mark!r}")


DEADLY = "dask_cluster:deadly"


def deadly(simspec: SimSpec, decomposition: object, folder: Path, realization: str) -> SessionResult:
    """As `campaign_fakes.mixed_ends`; but the first session of all kills what a file names, and waits to be killed."""
    from campaign_fakes import mixed_ends

    marks = Path(os.environ[MARKS])
    try:
        (marks / "victim").rename(marks / realization)
    except FileNotFoundError:
        return mixed_ends(simspec, decomposition, folder, realization)
    victim = (marks / realization).read_text()
    # A worker's own child is the process that flies, so its parent is the Dask worker.
    os.kill(os.getppid() if victim == "worker" else int(victim), signal.SIGKILL)
    signal.pause()
    raise AssertionError("nothing ends the pause but a kill")
