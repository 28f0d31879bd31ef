"""A campaign on a Slurm cluster: dask-jobqueue submits jobs whose workers fly the sessions.

On the login node: .venv/bin/pip install dask-jobqueue; .venv/bin/python slurm.py CAMPAIGN FOLDER [JOBS]
"""

from __future__ import annotations

import subprocess
import sys

import dask
from dask_jobqueue import SLURMCluster

CORES_OF_A_JOB = 8


def main(campaign: str, folder: str, jobs: int) -> int:
    """Run the campaign with `jobs` Slurm jobs of eight sessions each, and return the exit code of `rebar run`."""
    # The campaign's journal decides what is flown again, so the scheduler must not.
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    cluster = SLURMCluster(
        cores=CORES_OF_A_JOB,
        processes=CORES_OF_A_JOB,  # one thread in each: a session for each core
        memory="16GB",
        walltime="04:00:00",
        # Workers that leave before Slurm ends the job take no further session; the margin is a session's budget.
        worker_extra_args=["--lifetime", "3h50m", "--lifetime-stagger", "5m"],
        local_directory="$TMPDIR",
        scheduler_options={"dashboard": False},
    )
    with cluster:
        cluster.scale(jobs=jobs)
        executor = f"dask={cluster.scheduler_address}"
        command = ["rebar", "run", campaign, "--out", folder, "--executor", executor]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 4))
