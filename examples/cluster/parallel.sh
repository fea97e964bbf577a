#!/bin/sh
# A sweep with GNU parallel: on this machine, or with PARALLEL='--sshloginfile nodes' on the machines in the file `nodes`.
# A failed shard is resumed; repeating the command resumes missing shards.
#
#   examples/cluster/parallel.sh area.toml runs/area 8
set -eu

usage='usage: parallel.sh SWEEP OUT SHARDS'
sweep=${1:?$usage} out=${2:?$usage} shards=${3:?$usage}
numbers=$(seq "$shards")
mkdir -p "$out-shards"
parallel --quote --retries 3 --workdir "$PWD" \
    skysink sweep "$sweep" --out "$out-shards/{}" --shard "{}/$shards" --threads 1 ::: $numbers
skysink merge "$out-shards"/* --out "$out"
