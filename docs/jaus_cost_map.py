#!/usr/bin/env python3
"""A planner's side of docs/jaus.md in plain Python: subscribe to the cost map, print each one as it comes.

    python3 docs/jaus_cost_map.py 127.0.0.1:3794 [component]

It finds the sensor, creates an event on every change of ReportCostMap2D, puts the parts together, and creates the event
again every 20 s so that it does not end. Needs nothing but Python 3.8.
"""
import math
import os
import socket
import struct
import sys
import time

# Component, node, subsystem. An id belongs to the address that used it until that is silent for 10 s, so each run has another.
US = struct.pack("<BBH", os.getpid() % 254 + 1, 1, 126)
EVERYBODY = b"\xff\xff\xff\xff"
CREATE_EVENT = struct.pack("<HBBHI", 0x01F0, 1, 1, 0, 3) + struct.pack("<HB", 0xD738, 0)


def scaled(value, bits, low, high):
    return low + value * (high - low) / (2**bits - 1)


def show(report):
    """Prints where a cost map lies and what is in it."""
    rows, columns, width, height, frame = struct.unpack_from("<HHHHB", report, 2)
    latitude, longitude, rotation, form, count = struct.unpack_from("<IIHBH", report, 11)
    cells = report[24 : 24 + count]
    assert frame == 0 and form == 0 and count == rows * columns == len(cells)
    driven, lethal, unknown = (sum(map(test, cells)) for test in (lambda c: c < 254, lambda c: c == 254, lambda c: c == 255))
    print(
        f"{rows} x {columns} cells, {scaled(width, 16, 0, 10000):.2f} x {scaled(height, 16, 0, 10000):.2f} m around "
        f"{scaled(latitude, 32, -90, 90):.7f} {scaled(longitude, 32, -180, 180):.7f}, turned "
        f"{math.degrees(scaled(rotation, 16, -math.pi, math.pi)):.3f} deg: {driven} drivable, {lethal} impassable, {unknown} unknown"
    )


def main(address, component):
    host, port = address.rsplit(":", 1)
    sensor_at = (host, int(port))
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    wire.settimeout(1.0)
    sequence, sensor, parts, asked_at = 0, None, b"", 0.0
    while True:
        if time.monotonic() - asked_at > (20.0 if sensor else 1.0):
            asked_at, sequence = time.monotonic(), (sequence + 1) % 65536
            # Who is there, as a component? Then: the cost map on every change.
            body = CREATE_EVENT if sensor else struct.pack("<HB", 0x2B00, 4)
            head = struct.pack("<BBHB", 2, 0, len(body) + 14, 1) + (sensor or EVERYBODY) + US
            wire.sendto(head + body + struct.pack("<H", sequence), sensor_at)
        try:
            datagram = wire.recv(65536)
        except socket.timeout:
            continue
        at = 1
        while at < len(datagram):
            size, flags = struct.unpack_from("<HB", datagram, at + 1)
            source, body = datagram[at + 8 : at + 12], datagram[at + 12 : at + size - 2]
            at += size
            if flags >> 4 & 3:  # an acknowledgement
                continue
            parts = body if flags >> 6 in (0, 1) else parts + body
            if flags >> 6 in (1, 2):  # more parts come
                continue
            code = struct.unpack_from("<H", parts)[0]
            if code == 0x4B00 and sensor is None:
                sensor, asked_at = struct.pack("<B", component) + source[1:], 0.0
                print(f"found {parts[6:].decode()!r}")
            elif code == 0x41F1:
                show(parts[8:])


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:3794", int(sys.argv[2]) if len(sys.argv) > 2 else 20)
    except KeyboardInterrupt:
        pass
