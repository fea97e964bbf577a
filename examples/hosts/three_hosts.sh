#!/bin/sh
# A ring across three hosts, emulated on one machine: each host is a network namespace with its own shared memory and
# temporary folder, so that only the network connects them.
#
#   host a  10.77.0.1  skysink run: launcher, field-sim
#   host b  10.77.0.2  planner
#   host c  10.77.0.3  flight-sim
#
# Usage, as root, with skysink and skysink-link (or iox2-link-tunnel-zenoh) in the PATH:
#
#   three_hosts.sh SCENARIO [--cut HOST SECONDS] [options of skysink run]
#
# It compares the trace with that of one process. With --cut it disconnects a host for this time during the run.
# Example: three_hosts.sh scenarios/letter.toml --cut b 5
set -eu

here=$(cd "$(dirname "$0")" && pwd)
scenario=$(realpath "$1")
shift
cut_host=
if [ "${1:-}" = --cut ]; then
    cut_host=$2 cut_s=$3
    shift 3
fi
work=$(mktemp -d /tmp/hosts.XXXX) # short: iceoryx2 puts sockets there

# The network: a bridge, and a cable from each host to it. The names are those of this script, so that two can run.
id=$$
tidy() {
    jobs -p >"$work/jobs" && xargs -r kill <"$work/jobs" 2>/dev/null || true
    wait || true
    for host in a b c; do ip netns del "sky$id$host" 2>/dev/null || true; done
    ip link del "sky$id" 2>/dev/null || true
    rm -rf "$work"
}
trap tidy EXIT
trap 'exit 130' INT TERM

ip link add "sky$id" type bridge
ip link set "sky$id" up
number=1
for host in a b c; do
    mkdir -p "$work/$host"
    ip netns add "sky$id$host"
    ip link add "sky$id$host" type veth peer name eth0 netns "sky$id$host"
    ip link set "sky$id$host" master "sky$id" up
    ip -n "sky$id$host" address add "10.77.0.$number/24" dev eth0
    ip -n "sky$id$host" link set eth0 up
    ip -n "sky$id$host" link set lo up
    number=$((number + 1))
done

# on HOST COMMAND...: runs it on that host. `ip netns exec` has given the command mounts of its own.
on() {
    on_host=$1
    shift
    exec ip netns exec "sky$id$on_host" sh -c '
        mount -t tmpfs -o size=4g tmpfs /dev/shm
        export TMPDIR="$0" && cd "$0" && exec "$@"' "$work/$on_host" "$@"
}

# Host a: the launcher. It waits for the processes of the other hosts, and says what to start there.
(on a skysink run "$scenario" --no-viewer --out run --link "$here/link.json5" \
    --external planner --external flight-sim "$@") &
launcher=$!

# What the other hosts need, two small files: here by cp, else by scp.
until grep -qs '^\[link\]' "$work"/a/skysink-0/*/ring.toml && [ -s "$work/a/run/scenario.toml" ]; do
    kill -0 $launcher # it may have been refused its arguments
    sleep 0.05
done
for host in b c; do
    cp "$work"/a/skysink-0/*/ring.toml "$work/a/run/scenario.toml" "$work/$host"
    ! [ -e "$work/a/run/sensors.csv" ] || cp "$work/a/run/sensors.csv" "$work/$host"
done

# Hosts b and c: one process each. skysink join supervises it, and ends when the run does.
(on b skysink join planner --ring ring.toml --scenario scenario.toml --link "$here/link.json5") 2>&1 | sed 's/^/b: /' &
(on c skysink join flight-sim --ring ring.toml --scenario scenario.toml --link "$here/link.json5") 2>&1 | sed 's/^/c: /' &

flown() {
    wc -l <"$work/a/run/slots.csv"
}
if [ -n "$cut_host" ]; then
    until [ -e "$work/a/run/slots.csv" ] && [ "$(flown)" -gt 50 ]; do
        kill -0 $launcher
        sleep 0.05
    done
    ip link set "sky$id$cut_host" down
    echo "three_hosts: host $cut_host has no network: $(flown) lines recorded"
    sleep "$cut_s"
    ip link set "sky$id$cut_host" up
    echo "three_hosts: host $cut_host has its network back: $(flown) lines recorded"
fi

wait $launcher || exit # the run itself failed
wait # for the other two
cd "$work"
skysink simulate a/run/scenario.toml --out alone >/dev/null
if cmp alone/slots.csv a/run/slots.csv; then
    echo "three_hosts: the trace is that of one process, byte for byte"
else
    echo "three_hosts: the trace differs, as it does in a paced run with misses" && exit 3
fi
