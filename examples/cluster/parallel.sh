#!/bin/bash
# A sweep by GNU parallel: on this machine, or with PARALLEL='--sshloginfile nodes' on all that are in the file `nodes`.
# A shard whose process fails is flown again, from where it was; so is what is missing when the same command is given.
#
#   examples/cluster/parallel.sh area.toml runs/area 8
set -euo pipefail

usage='usage: parallel.sh SWEEP OUT SHARDS'
sweep=${1:?$usage} out=${2:?$usage} shards=${3:?$usage}
numbers=$(seq "$shards")
mkdir -p "$out-shards"
parallel --quote --retries 3 --workdir "$PWD" \
    skysink sweep "$sweep" --out "$out-shards/{}" --shard "{}/$shards" --threads 1 ::: $numbers
skysink merge "$out-shards"/* --out "$out"
