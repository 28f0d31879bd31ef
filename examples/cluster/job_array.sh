#!/bin/sh
# A campaign in shards, as a job array of Slurm: sbatch --array=1-8 job_array.sh CAMPAIGN FOLDER
# Each job flies its shard on its node's own disk, and brings it to FOLDER on the disk that all nodes see, which needs no
# locks for that. Submit it again to go on with a job that was ended. Needs `rebar` on PATH.
#SBATCH --cpus-per-task=4
# Two minutes before the time limit, the runner is told to end, so that what was flown is brought home.
#SBATCH --signal=B:TERM@120
set -eu
shard="$SLURM_ARRAY_TASK_ID-of-$SLURM_ARRAY_TASK_COUNT"
home="$2/$shard"
own="${TMPDIR:-/tmp}/rebar-shard-${SLURM_ARRAY_JOB_ID:-0}-$shard"

rm -rf "$own"
# A job that was killed while it exchanged them.
if [ ! -d "$home" ] && [ -d "$home.old" ]; then mv "$home.old" "$home"; fi
rm -rf "$home.old"
if [ -d "$home" ]; then cp -R "$home" "$own"; fi
rebar run "$1" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers "${SLURM_CPUS_PER_TASK:-1}" --out "$own" &
runner=$!
trap 'kill -TERM "$runner" 2>/dev/null || true' TERM INT
code=0
wait "$runner" || code=$?
# A signal ends `wait` and not the runner, which takes its sessions down first.
while kill -0 "$runner" 2>/dev/null; do wait "$runner" || code=$?; done

# The old copy stays until the new one is in its place.
mkdir -p "$2"
rm -rf "$home.new"
cp -R "$own" "$home.new"
if [ -d "$home" ]; then mv "$home" "$home.old"; fi
mv "$home.new" "$home"
rm -rf "$home.old" "$own"
exit "$code"
