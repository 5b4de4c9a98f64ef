#!/usr/bin/env python3
"""The traversability grid of docs/ros2.md heard without ROS: a line for each one that comes.

    pip install cyclonedds
    python3 docs/ros2_grid.py [domain]

It looks for publishers on this machine alone, unless CYCLONEDDS_URI says otherwise.
"""
import os
import sys
from dataclasses import dataclass

os.environ.setdefault(
    "CYCLONEDDS_URI",
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer Address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
)
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, float64, int8, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


# The message nav_msgs/OccupancyGrid, field by field.
@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class MapMetaData(IdlStruct, typename="nav_msgs.msg.dds_.MapMetaData_"):
    map_load_time: Time
    resolution: float32
    width: uint32
    height: uint32
    origin: Pose


@dataclass
class OccupancyGrid(IdlStruct, typename="nav_msgs.msg.dds_.OccupancyGrid_"):
    header: Header
    info: MapMetaData
    data: sequence[int8]


def main(domain):
    # Reliable, and the newest one for who joins late: what is offered.
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    topic = Topic(DomainParticipant(domain), "rt/tsense/traversability", OccupancyGrid, qos=qos)
    for grid in DataReader(topic.participant, topic, qos=qos).take_iter(timeout=duration(seconds=3600)):
        info, cells = grid.info, grid.data
        drivable, lethal = sum(0 <= cell < 100 for cell in cells), sum(cell == 100 for cell in cells)
        print(
            f"{info.height} x {info.width} cells of {info.resolution:.2f} m from {info.origin.position.x:.2f} "
            f"{info.origin.position.y:.2f} in {grid.header.frame_id}: {drivable} drivable, {lethal} impassable, "
            f"{len(cells) - drivable - lethal} unknown",
            flush=True,
        )


if __name__ == "__main__":
    try:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    except KeyboardInterrupt:
        pass
