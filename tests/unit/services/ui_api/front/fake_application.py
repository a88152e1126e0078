"""A process in the application's place: beats, and records every stop, until it is ended, or hears of a stop 'die'."""

import argparse
import socket
import sys

from services.ui_api.front_link import FrontLink
from services.ui_api.link_messages import FROM_FRONT, Listening, StopEnded, StopRecorded


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--link", type=int, required=True)
    parser.add_argument("--streams", type=int, required=True)
    parser.add_argument("--listening", type=int, required=True)
    given = parser.parse_args()
    with socket.socket(fileno=given.link) as line:
        link = FrontLink(line, lambda: None)
        with link.beating():
            link.send(Listening())
            for content in line.makefile("rb"):
                message = FROM_FRONT.validate_json(content)
                if isinstance(message, StopEnded) and message.reason == "die":
                    return 1
                if isinstance(message, StopEnded):
                    link.send(StopRecorded(number=message.number))
    return 0


if __name__ == "__main__":
    sys.exit(main())
