#!/usr/bin/env bash
# Simulates the sweeps of scenarios/sweeps and the missions behind the paper's figures, and draws them. Pictures of the
# book are copied to docs/src. All parts take hours; running the script again resumes the sweeps.
#
# `area` and `rate` include the sweeps of the strategies that look ahead, which take most of the time.
#
# Usage: docs/figures.sh [PART...]     area rate time planning sparse knowledge altitude maps example (default: all)
#
# Sweeps, runs and pictures are in runs/figures; `skysink` is the one in PATH.
set -euo pipefail
cd "$(dirname "$0")/.."
out=runs/figures
all=(area rate time planning sparse knowledge altitude maps example)

side="side of the area [m]"
one_slot=rfs,gfs,uts,uts-wide,exact
planned=tour,round-robin,max-age-first,horizon # 20 fields are too few for the others, which may be trapped

# sweep NAME OPTION...: simulates scenarios/sweeps/NAME.toml.
sweep() {
    skysink sweep "scenarios/sweeps/$1.toml" --out "$out/$1" "${@:2}"
}

# plot PICTURE SWEEP OPTION...: draws a sweep to a folder of the picture.
plot() {
    skysink plot "$out/$2" --out "$out/pictures/$1" "${@:3}"
}

# book PICTURE: copies a picture to the book.
book() {
    cp "$out/pictures/$1"/*.png "docs/src/$1.png"
}

# radios PICTURE SWEEP TITLE OPTION...: draws a sweep for both bandwidths.
radios() {
    plot "$1" "$2" --title "$3 · W = 5 MHz, the paper's" --where link.bandwidth_hz=5e6 "${@:4}"
    plot "$1-narrow" "$2" --title "$3 · W = 5 kHz" --where link.bandwidth_hz=5e3 "${@:4}"
}

draw_area() {
    sweep loss-area
    radios loss-area loss-area "Data loss against the area" --x area.side_m --x-label "$side" --strategies $one_slot
    radios bits-area loss-area "Bits per waypoint against the area" --y bits_per_waypoint --x area.side_m --x-label "$side"
    book loss-area
    sweep loss-area-ahead
    radios loss-area-ahead loss-area-ahead "Data loss against the area" --x area.side_m --x-label "$side" \
        --strategies $planned --bounds
    radios loss-area-difference loss-area "Data loss against the area, difference by field" --x area.side_m \
        --x-label "$side" --difference-to uts
}

draw_rate() {
    local axis=(--x sensors.sampling_bps --x-label "sampling rate s [bit/s]")
    sweep loss-rate
    radios loss-rate loss-rate "Data loss against the sampling rate" "${axis[@]}"
    sweep loss-rate-ahead
    radios loss-rate-ahead loss-rate-ahead "Data loss against the sampling rate" "${axis[@]}" \
        --strategies $planned --bounds
    radios loss-rate-difference loss-rate "Data loss against the sampling rate, difference by field" \
        "${axis[@]}" --difference-to uts
}

draw_time() {
    local axis=(--x slots --x-label "mission time [slots of 1 s]")
    sweep loss-time
    radios loss-time loss-time "Data loss against mission time" "${axis[@]}"
    radios loss-time-difference loss-time "Data loss against mission time, difference by field" "${axis[@]}" \
        --difference-to uts
}

draw_planning() {
    sweep planning-time --threads 1
    radios planning-time planning-time "Planning time of a slot, median of each mission" --y plan_p50_us --log-y \
        --x sensors.count --x-label "sensor nodes N in 100 m × 100 m"
}

draw_sparse() {
    sweep loss-sparse
    plot loss-sparse-difference loss-sparse --title "Data loss in sparse fields, difference by field" --x area.side_m \
        --x-label "$side" --difference-to tour
    sweep loss-sparse-ahead
    plot loss-sparse loss-sparse-ahead --title "Data loss in sparse fields · W = 5 MHz, the paper's" --x area.side_m \
        --x-label "$side" --strategies $planned --bounds
    plot loss-sparse-ahead-difference loss-sparse-ahead --title "Data loss in sparse fields, difference by field" \
        --x area.side_m --x-label "$side" --strategies $planned --bounds --difference-to tour
    book loss-sparse
}

draw_knowledge() {
    local field="rates of 50 to 150 bit/s, initial queues of 0 to 20 kbit"
    sweep knowledge
    plot knowledge knowledge --title "Data loss for not knowing · $field" --x area.side_m --x-label "$side" \
        --by planner.knowledge
    plot knowledge-difference knowledge --title "Data loss for not knowing, difference by field · $field" \
        --x area.side_m --x-label "$side" --by planner.knowledge --difference-to oracle
    sweep learnt-rates
    plot learnt-rates learnt-rates --title "Data loss for not knowing · $field" --x area.side_m --x-label "$side" \
        --by planner.rates
}

draw_altitude() {
    local environment
    sweep altitude-free
    for environment in suburban urban dense-urban high-rise; do
        local options=(--x uav.altitude_m --x-label "altitude [m]" --by uav.altitude
            --where "link.environment=$environment")
        plot "altitude-$environment" altitude-free --title "Data loss against altitude · $environment" "${options[@]}"
        plot "altitude-difference-$environment" altitude-free "${options[@]}" --difference-to fixed \
            --title "Data loss against altitude, difference by field · $environment"
        plot "altitude-bits-$environment" altitude-free --y bits_per_waypoint "${options[@]}" \
            --title "Bits per waypoint against altitude · $environment"
    done
    cp "$out"/pictures/altitude-dense-urban/*.png docs/src/altitude.png
}

# map PICTURE SIDE: the trajectories of one field of this side [m].
map() {
    local strategy runs=()
    for strategy in rfs gfs uts uts-wide exact tour max-age-first horizon; do
        runs+=("$out/$1/$strategy")
        skysink simulate scenarios/letter.toml --strategy $strategy --set slots=500 --set "area.side_m=$2" \
            --set planner.horizon.iterations=2000 --out "$out/$1/$strategy" --force
    done
    skysink plot "${runs[@]}" --title "Trajectories over 500 slots · $2 m × $2 m" --out "$out/pictures/$1"
}

draw_maps() {
    map map-letter 100
    map map-sparse 300
    book map-sparse
}

draw_example() {
    sweep letter
    plot plot letter --x area.side_m --where link.bandwidth_hz=5e3 --width 88mm
    book plot
}

parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=("${all[@]}")
for part in "${parts[@]}"; do
    [[ " ${all[*]} " == *" $part "* ]] || { echo "docs/figures.sh: $part: expected one of ${all[*]}" >&2; exit 2; }
done
for part in "${parts[@]}"; do
    "draw_$part"
done
