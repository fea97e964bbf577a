#!/bin/bash
# A sweep as a Slurm job array with a merge that waits for it. The folders lie on a file system that all nodes share.
#
#   examples/cluster/slurm.sh area.toml runs/area 100           # 100 shards
#   examples/cluster/slurm.sh area.toml runs/area 100 7,12-14   # again those that the merge says are missing
set -euo pipefail

sweep=$1 out=$2 shards=$3 array=${4:-1-$3}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out-shards"
job=$(sbatch --parsable --array="$array" "$here/shard.slurm" "$sweep" "$out-shards" "$shards")
sbatch --dependency="afterany:$job" "$here/merge.slurm" "$out-shards" "$out"
