"""A foreign ROS 2 peer over Zenoh for the tests: PyPI `eclipse-zenoh` as router and as subscriber.

zenoh_peer.py ENDPOINT DOMAIN    JSON lines: tokens, and samples as hex with their attachment. For each key on standard input it
                                 joins late: what it is given of the past is marked so.
"""

import json
import sys
import threading

import zenoh
import zenoh.ext


LOCK = threading.Lock()


def say(**line):
    # Zenoh calls back from threads of its own.
    with LOCK:
        print(json.dumps(line), flush=True)


def sample(late):
    def heard(sample):
        attachment = bytes(sample.attachment).hex() if sample.attachment else None
        say(key=str(sample.key_expr), payload=bytes(sample.payload).hex(), attachment=attachment, late=late)

    return heard


def main(endpoint, domain):
    config = zenoh.Config()
    for key, value in (
        ("mode", '"router"'),
        ("listen/endpoints", json.dumps([endpoint])),
        ("scouting/multicast/enabled", "false"),
    ):
        config.insert_json5(key, value)
    session = zenoh.open(config)
    keep = [
        session.liveliness().declare_subscriber(
            f"@ros2_lv/{domain}/**", lambda token: say(token=str(token.key_expr)), history=True
        ),
        session.declare_subscriber(f"{domain}/**", sample(False)),
    ]
    say(ready=True)
    for line in sys.stdin:
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
        keep.append(zenoh.ext.declare_advanced_subscriber(session, line.strip(), sample(True), history=history))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
