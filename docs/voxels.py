#!/usr/bin/env python3
"""A sensor of voxels in Python: docs/voxel-sensors.md as a program that says, ten times a second, that a wall of 3 x 3 m stands
8 m north of the vehicle, and that the way there is free.

    pip install iceoryx2==0.10.0 numpy
    python3 docs/voxels.py stereo [seconds] [graph]

The configuration names it: [[mapper.voxel_sensor]] with name = "stereo".
"""
import ctypes
import json
import os
import sys
import time

import iceoryx2 as iox2
import numpy as np


def struct(type_name, size, fields):
    """A message as the topic knows it, by its name and by the offsets in contract/layout.txt."""
    at, members = 0, []
    for offset, name, kind in fields:
        if offset > at:
            members.append((f"skipped_{at}", ctypes.c_uint8 * (offset - at)))
        members.append((name, kind))
        at = offset + ctypes.sizeof(kind)
    if size > at:
        members.append((f"skipped_{at}", ctypes.c_uint8 * (size - at)))
    name = {"type_name": staticmethod(lambda: type_name)}
    made = type(type_name.replace(".", "_"), (ctypes.Structure,), {"_fields_": members, **name})
    assert ctypes.sizeof(made) == size, type_name
    return made


f64, i64, u64, u8 = ctypes.c_double, ctypes.c_int64, ctypes.c_uint64, ctypes.c_uint8
Pose = struct(
    "tsense.pose.v1",
    104,
    [(0, "stamp_ns", i64), (8, "at_m", f64 * 3), (100, "zone", u8), (101, "south", u8)],
)
Nothing = struct("tsense.nothing.v1", 1, [(0, "zero", u8)])
VoxelsHeader = struct(
    "tsense.voxels.v1",
    56,
    [
        (0, "stamp_ns", i64),
        (8, "sequence", u64),
        (16, "origin_m", f64 * 3),
        (40, "voxel_size_m", f64),
        (48, "zone", u8),
        (49, "south", u8),
        (50, "kind", u8),
    ],
)
SensedVoxel = struct("tsense.sensed_voxel.v1", 16, [(0, "xyz_m", ctypes.c_float * 3), (12, "state", u8)])
VOXEL = np.dtype([("xyz_m", "<f4", 3), ("state", "u1"), ("zero", "u1", 3)])
FREE, OCCUPIED, SIZE_M = 1, 2, 0.15


def topic(node, name, header, item):
    builder = node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(iox2.Slice[item])
    return builder.user_header(header).open()


def graph_clock(facts):
    """Nanoseconds since 1970 on the graph's clock."""
    clock = facts["clock"]
    passed = time.clock_gettime_ns(time.CLOCK_MONOTONIC) - clock["monotonic_ns"]
    return clock["epoch_ns"] + int(passed * clock["speed"])


def wall():
    """Voxels relative to the vehicle: east, north, up."""
    steps = np.arange(-10, 11) * SIZE_M
    east, north, up = np.meshgrid(steps, np.arange(27, 54) * SIZE_M, steps + 1.5, indexing="ij")
    voxels = np.zeros(east.size, VOXEL)
    voxels["xyz_m"] = np.stack([east, north, up], axis=-1).reshape(-1, 3)
    voxels["state"] = np.where(north.ravel() > 7.9, OCCUPIED, FREE)
    return voxels


def main(sensor="stereo", seconds="10", graph="tsense"):
    root = f"/dev/shm/ts-{os.getuid()}-{graph}"
    settings = iox2.config.from_file(iox2.FilePath.new(f"{root}/iceoryx2.toml"))
    with open(f"{root}/graph.json", encoding="utf-8") as file:
        facts = json.load(file)
    node = iox2.NodeBuilder.new().config(settings).create(iox2.ServiceType.Ipc)
    poses = topic(node, "pose", Pose, Nothing).subscriber_builder().create()
    voxels = topic(node, f"voxels/{sensor}", VoxelsHeader, SensedVoxel).publisher_builder()
    voxels = voxels.initial_max_slice_len(1 << 16).create()
    end, sequence, pose = time.monotonic() + float(seconds), 0, None
    while time.monotonic() < end:
        time.sleep(0.1)
        voxels.update_connections()
        while (sample := poses.receive()) is not None:
            pose = Pose.from_buffer_copy(sample.user_header().contents)
        if pose is None or pose.zone == 0:
            continue
        items = wall()
        loan = voxels.loan_slice_uninit(len(items))
        header = loan.user_header().contents
        header.stamp_ns, header.sequence = graph_clock(facts), sequence
        header.origin_m, header.voxel_size_m = pose.at_m, SIZE_M
        header.zone, header.south, header.kind = pose.zone, pose.south, 0
        ctypes.memmove(loan.payload_ptr, items.ctypes.data, items.nbytes)
        loan.assume_init().send()
        sequence += 1
    print(f"{sequence} samples of {len(wall())} voxels")


if __name__ == "__main__":
    main(*sys.argv[1:])
