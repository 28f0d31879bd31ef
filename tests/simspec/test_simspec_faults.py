"""Kinds of failures and outages: what every room reads from their declarations."""

from __future__ import annotations

from typing import get_args

import pytest
from pydantic import ValidationError

from bench.simspec import FAILURES, OUTAGES, Failure, FailureKind, OutageKind

VALUES = {
    "duration_s": 7.5,
    "instance": 3,
    "link": "onboard",
    "to_fraction": 0.35,
    "drift_mps": 0.5,
    "towards_deg": 45.0,
}


def test_every_kind_is_declared_and_none_beside() -> None:
    assert tuple(FAILURES) == get_args(FailureKind)
    assert tuple(OUTAGES) == get_args(OutageKind)


@pytest.mark.parametrize("kind", FAILURES)
def test_a_failure_takes_the_fields_of_its_kind_and_no_others(kind: str) -> None:
    declared = FAILURES[kind]
    full = {"at_s": 10.0, "kind": kind} | {name: VALUES[name] for name in declared.takes}
    failure = Failure.model_validate(full)
    assert failure.until_s == (17.5 if "duration_s" in declared.takes else float("inf"))
    for name in VALUES.keys() - {*declared.takes}:
        with pytest.raises(ValidationError, match=f"{kind} takes no {name}; it takes "):
            Failure.model_validate(full | {name: VALUES[name]})
    for name in declared.takes:
        left = {key: value for key, value in full.items() if key != name}
        if name == declared.needs:
            with pytest.raises(ValidationError, match=f"{kind} needs {name}"):
                Failure.model_validate(left)
        else:
            Failure.model_validate(left)


def test_a_story_tells_each_failure_with_its_numbers() -> None:
    told = {
        kind: declared.tell(
            Failure.model_validate(
                {"at_s": 1.0, "kind": kind} | {name: VALUES[name] for name in declared.takes}
            )
        )
        for kind, declared in FAILURES.items()
    }
    assert told == {
        "gps_off": "no GPS fixes",
        "gps_drift": "fixes drift by 0.5 m/s towards 45°",
        "battery_drop": "the battery falls to 35 %",
        "motor_off": "rotor 3 stops",
        "link_loss": "MAVLink link onboard is cut",
    }
    assert FAILURES["link_loss"].tell(Failure(at_s=1.0, kind="link_loss")) == "every MAVLink link is cut"
