#!/bin/sh
# A scheduler, two workers and the runner, each a process of its own: what a cluster has, on one machine.
# Usage, from anywhere: sh run_local.sh [FOLDER]. Needs `dask` and `rebar` on PATH.
set -eu
here=$(dirname "$0")
folder=${1:-out/cluster}
address=tcp://127.0.0.1:${PORT:-8786}
# The campaign's journal decides what is flown again, so the scheduler must not.
export DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0
scratch=$(mktemp -d)
processes=
trap 'kill $processes 2>/dev/null; wait; rm -rf "$scratch"' EXIT INT TERM

dask scheduler --host 127.0.0.1 --port "${PORT:-8786}" --no-dashboard >"$scratch/scheduler.log" 2>&1 &
processes="$!"
for _ in 1 2; do
    dask worker "$address" --host 127.0.0.1 --nthreads 1 --no-dashboard --local-directory "$scratch" \
        >>"$scratch/workers.log" 2>&1 &
    processes="$processes $!"
done

rebar run "$here/campaign.yaml" --executor "dask=$address" --out "$folder"
rebar verify "$folder"
