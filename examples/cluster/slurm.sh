#!/bin/bash
# A sweep as a Slurm job array with a merge that waits for it. The folders lie on a file system that all nodes share.
#
#   examples/cluster/slurm.sh area.toml runs/area 100           # 100 shards
#   examples/cluster/slurm.sh area.toml runs/area 100 7,12-14   # again those that the merge says are missing
set -euo pipefail

usage='usage: slurm.sh SWEEP OUT SHARDS [ARRAY]'
sweep=${1:?$usage} out=${2:?$usage} shards=${3:?$usage} array=${4:-1-$3}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out-shards"
job=$(sbatch --parsable --array="$array" "$here/shard.slurm" "$sweep" "$out-shards" "$shards")
job=${job%%;*} # without the name of the cluster
echo "Submitted job array $job; what the merge says will be in the output of"
sbatch --dependency="afterany:$job" "$here/merge.slurm" "$out-shards" "$out"
