"""A moment is the same in whatever zone it is written, and on a host in whatever zone."""

from __future__ import annotations

import calendar
import json
import os
import subprocess
import sys
import time

# 11:30 UTC, written at three meridians; by two of them it is another day of the month or another year.
SPELLINGS = {
    "2026-06-21T11:30:00Z": ("2026-06-21T13:30:00+02:00", "2026-06-21T11:30:00", "2026-06-22T01:30:00+14:00"),
    "2026-01-01T05:15:00Z": ("2025-12-31T23:15:00-06:00", "2026-01-01T05:15:00"),
}
# What the bench says and computes of a moment, and the stamps that it writes now.
PROGRAM = """
import datetime as dt, json, os, sys, time
from bench.campaign.storage._journal import _now
from bench.laboratory import message_of
from bench.campaign import CampaignPlanned
from bench.reporting.text._campaign_facts import _SITUATION
from bench.simspec import SimSpec, factor_values
from bench.simspec._sun import sun_at

def facts(spelling):
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (300, 0), (300, 300))]
    spec = SimSpec.model_validate(
        {"name": "t", "world": {"area": {"corners": corners}}, "environment": {"start_utc": spelling}}
    )
    moment = dt.datetime.fromisoformat(spelling)
    sun = sun_at(moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC), 47.4, 8.5)
    return {
        "text": dict(_SITUATION)["Start"](spec),
        "json": spec.model_dump_json(),
        "sun": [sun.elevation_rad, sun.azimuth_rad, sun.hours_from_noon],
        "factor": factor_values(spec)["hours_from_solar_noon"],
        "unix": spec.environment.start_utc.timestamp(),
    }

def answer():
    message = message_of(CampaignPlanned(1, 0), "c", 0, dt.datetime.now(dt.UTC))
    stamps = [_now(), json.loads(message.model_dump_json())["sent_utc"]]
    return {"hour": time.localtime(0).tm_hour, "facts": {s: facts(s) for s in sys.argv[1:]}, "stamps": stamps}

answers = [answer()]
os.environ["TZ"] = "Pacific/Kiritimati"
time.tzset()
print(json.dumps([*answers, answer()]))
"""


def test_one_moment_is_one_moment() -> None:
    """In a process that begins in one zone, and in another one later."""
    spellings = [spelling for moment, others in SPELLINGS.items() for spelling in (moment, *others)]
    started_s = time.time()
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, *spellings],
        env={**os.environ, "TZ": "America/Chicago"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    answers = json.loads(ran.stdout)
    # Of these zones at the beginning of 1970.
    assert [answer["hour"] for answer in answers] == [18, 13]
    for answer in answers:
        for moment, others in SPELLINGS.items():
            facts = answer["facts"][moment]
            assert facts["text"] == f"{moment[:10]} {moment[11:16]} UTC"
            assert facts["unix"] == {"06": 1_782_041_400.0, "01": 1_767_244_500.0}[moment[5:7]]
            assert all(answer["facts"][other] == facts for other in others)
        from_noon = [facts["factor"] for facts in answer["facts"].values()]
        assert max(from_noon) - min(from_noon) > 5.0
        for stamp in answer["stamps"]:
            assert stamp.endswith(("Z", "+00:00"))
            # As the host's own clock counts, which knows no zone.
            assert started_s - 1.0 <= calendar_s(stamp) <= time.time() + 1.0


def calendar_s(stamp: str) -> float:
    """Seconds since 1970 of a stamp in UTC, read by its digits alone."""
    return float(calendar.timegm(time.strptime(stamp[:19], "%Y-%m-%dT%H:%M:%S")))
