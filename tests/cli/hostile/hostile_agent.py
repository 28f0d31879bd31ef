"""Puts texts that would rewrite a terminal wherever an agent may write, and then completes its mission or crashes."""

from __future__ import annotations

import os
import sys

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import open_bench, read_environment
from agent_adapters.null._autopilot import LINK
from agent_adapters.null._session import INTELLIGENCE, MISSION, NullSession, subscriptions

CLEAR, TITLE, CLIPBOARD = "\x1b[2J\x1b[H\x1b[31m", "\x1b]0;passed\x07", "\x1b]52;c;cm0gLXJm\x07"
HOSTILE = f"{CLEAR}{TITLE}{CLIPBOARD}\x9b2J\u202edessap\u202c\u2066\u200b\u2028\x85\x7f\r[red]passed[/red]"
"""Texts that a document refuses as a label, and keeps as free words."""
MARKUP = "[blink]m[/blink]"
"""A label that a document takes and a printer could obey."""
ACT_S, END_S = 1.0, 2.0


def speak(session: NullSession, say_mavlink: mavlink.MAVLink) -> None:
    """Every document that an agent may send, once refused for its labels and once taken."""
    report = {
        "class_label": "mobile_radar",
        "east_m": 1.0,
        "north_m": 2.0,
        "confidence": 0.9,
        "mark": True,
        "reason": HOSTILE,
        "bystanders_seen": 3,
    }
    intelligence = session.intelligence[0]["id"] if session.intelligence else "none"
    for label in (HOSTILE[:64], MARKUP):
        session.report({**report, "id": label, "intelligence_id": label, "repeats": label})
        session.report({**report, "id": f"{label[:60]}2", "class_label": label})
        session.report({**report, "id": f"{label[:60]}3", "intelligence_id": intelligence})
        session.decide(label, label, HOSTILE)
        session.answer({"id": label}, False, HOSTILE)
        track = {"east_m": 1.0, "north_m": 2.0, "confidence": 0.9, "frames": 3}
        session.tracks([{**track, "id": label, "class_label": label}])
        session._put("status", {"time_s": session.now_s, "phase": "searching", "text": HOSTILE})
    session._put("status", {"time_s": session.now_s, "phase": HOSTILE})
    session._publish(f"/{session._vehicle}/agent/decisions", HOSTILE)
    text = HOSTILE.encode()
    say_mavlink.statustext_send(2, text[:50])
    say_mavlink.param_set_send(1, 1, text[:16], 1.0, mavlink.MAV_PARAM_TYPE_REAL32)
    say_mavlink.param_request_read_send(1, 1, text[:16], -1)
    say_mavlink.file_transfer_protocol_send(
        0, 1, 1, [0, 0, 0, 4, 50, 0, 0, 0, 0, 0, 0, 0, *text[:50], *[0] * 189]
    )
    for stream in (sys.stdout, sys.stderr):
        print(HOSTILE, file=stream, flush=True)


def main() -> None:
    """Follow one session to its end."""
    environment = read_environment(os.environ, {LINK: "REBAR_MAVLINK"})
    with open_bench(
        "hostile", environment, subscriptions(environment.vehicle, (MISSION, INTELLIGENCE))
    ) as bench:
        session = NullSession(environment.vehicle, bench.publish, environment.seed)

        class Sender:
            def write(self, frame: bytes) -> None:
                bench.links[LINK].send(frame)

        say_mavlink = mavlink.MAVLink(Sender(), srcSystem=246)
        spoken = False
        for moment in bench.moments(MARKUP):
            session.receive(moment)
            if session.now_s >= ACT_S and not spoken:
                speak(session, say_mavlink)
                spoken = True
            elif session.now_s >= END_S and "--crash" in sys.argv:
                raise SystemExit(HOSTILE)
            elif session.now_s >= END_S:
                session.enter("complete")


if __name__ == "__main__":
    main()
