#!/usr/bin/env python3
"""Compares our voxel map with its peers on the same rays, interleaved, on one core; prints a table in Markdown.

usage: compare.py TSENSE PEERS_FOLDER [--voxel 0.15] [--rounds 3] [--case static ...]

TSENSE is a release build; PEERS_FOLDER is what build.sh made. The rays are written by `tsense simulate --write-rays`.
Every engine runs once a round, in turn, so that a busy machine troubles all alike. Times are processor time; the median
of the rounds counts. Needs nothing but Python's own library.
"""
import argparse
import json
import os
import platform
import statistics
import subprocess
import tempfile

PEERS = ["mrpt", "openvdb", "octomap"]
SECONDS = {"static": "10s", "clipped": "10s", "drive": "20s"}


def lines_of(command):
    """The JSON lines that a program prints, pinned to one core."""
    pinned = ["taskset", "-c", str(min(os.sched_getaffinity(0)))] + command
    printed = subprocess.run(pinned, check=True, capture_output=True, text=True).stdout
    return [json.loads(line) for line in printed.splitlines()]


def ours(tsense, rays, voxel):
    case = lines_of([tsense, "bench", "mapper", "--rays", rays, "--voxel", voxel, "--repeat", "3", "--json"])[0]["cases"][0]
    named = {f"ours, {name}": ns for name, ns in case["ns_per_beam_by_instruction_set"].items()}
    named["ours, default rules"] = case["ns_per_beam_default_rules"]
    return named, case


def peers(folder, rays, voxel):
    named = {}
    for peer in PEERS:
        repeat = "3" if peer == "mrpt" else "1"
        for line in lines_of([os.path.join(folder, peer), rays, "--voxel", voxel, "--repeat", repeat]):
            named[line["engine"]] = line["ns_per_beam"]
    return named


def measured(arguments, case, folder):
    rays = os.path.join(folder, case + ".ply")
    write = [arguments.tsense, "simulate", "--write-rays", rays, "--case", case, "--for", SECONDS[case]]
    subprocess.run(write, check=True, capture_output=True)
    rounds, figures = {}, None
    for _ in range(arguments.rounds):
        named, figures = ours(arguments.tsense, rays, arguments.voxel)
        for engine, ns in {**named, **peers(arguments.peers, rays, arguments.voxel)}.items():
            rounds.setdefault(engine, []).append(ns)
    return {engine: statistics.median(ns) for engine, ns in rounds.items()}, figures


def table(medians, best):
    """A row an engine, a column a case: nanoseconds a beam, and how many times our best is quicker."""
    cases = list(medians)
    rows = ["| engine | " + " | ".join(cases) + " |", "|---|" + "---|" * len(cases)]
    for engine in sorted(medians[cases[0]], key=lambda engine: medians[cases[0]][engine]):
        cells = []
        for case in cases:
            ns = medians[case][engine]
            cells.append(f"{ns:.0f} ({ns / medians[case][best]:.1f}x)")
        rows.append(f"| {engine} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("tsense")
    parser.add_argument("peers")
    parser.add_argument("--voxel", default="0.15")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--case", action="append")
    arguments = parser.parse_args()
    missing = [peer for peer in PEERS if not os.path.exists(os.path.join(arguments.peers, peer))]
    if missing:
        parser.error(f"{', '.join(missing)} not in {arguments.peers}: run benches/peers/build.sh {arguments.peers} first")
    medians, best = {}, None
    with tempfile.TemporaryDirectory() as folder:
        for case in arguments.case or SECONDS:
            medians[case], figures = measured(arguments, case, folder)
            best = "ours, " + figures["instruction_set"]
            visits = figures["voxel_visits"] / figures["beams"]
            snapshot, keyframe = figures["snapshot_us"], figures["keyframe"]
            print(f"- {case}: {figures['beams']} beams, {visits:.1f} voxels a beam; snapshot of three scans "
                  f"p50 {snapshot['p50']:.0f}, p99 {snapshot['p99']:.0f} us; all {keyframe['blocks']} blocks {keyframe['us']:.0f} us; "
                  f"{100 * figures['eroded_share']:.2f} % of {figures['surface_voxels']} surface voxels eroded")
    print(f"\nns a beam in {arguments.voxel} m voxels, and the ratio to {best}; {platform.machine()}:\n")
    print(table(medians, best))


if __name__ == "__main__":
    main()
