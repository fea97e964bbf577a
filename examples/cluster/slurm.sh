#!/bin/sh
# A sweep as a Slurm job array, followed by a merge. The folders must be on a shared file system.
#
#   examples/cluster/slurm.sh area.toml runs/area 100           # 100 shards
#   examples/cluster/slurm.sh area.toml runs/area 100 7,12-14   # repeats the shards that the merge lists as missing
set -eu

usage='usage: slurm.sh SWEEP OUT SHARDS [ARRAY]'
sweep=${1:?$usage} out=${2:?$usage} shards=${3:?$usage} array=${4:-1-$3}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out-shards"
job=$(sbatch --parsable --array="$array" "$here/shard.slurm" "$sweep" "$out-shards" "$shards")
job=${job%%;*} # without the name of the cluster
echo "Submitted job array $job; the result of the merge will be in the output of"
sbatch --dependency="afterany:$job" "$here/merge.slurm" "$out-shards" "$out"
