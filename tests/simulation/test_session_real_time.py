"""Deadlines of sessions in real time: late steps and jitter by an injected clock, and who is charged with them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_session import session_simspec
from test_session_rounds import FakeAgent, Host, session_of

from bench.contracts import AgentUsage, Outcome, Record, StepTiming, fact_of, facts_of
from bench.reporting._campaign_data import ReportData, Run
from bench.reporting.text._campaign_facts import campaign_facts
from bench.simspec import Mission, Pace
from bench.simulation._host_resources import usable_cores
from bench.simulation._step_timing import MIN_JUDGED_STEPS, StepClock, judged
from bench.simulation._stop_session import StopSession

STEP_S = 0.02


def test_percentiles_are_those_of_numpy() -> None:
    """On random delays, early steps count as punctual."""
    random = np.random.default_rng(7)
    for count in (1, 2, 99, 1000):
        delays = random.exponential(0.01, count) - 0.005
        clock = StepClock(STEP_S)
        for delay in delays:
            clock.record(float(delay))
        timing = clock.summary()
        reference = np.percentile(np.maximum(delays, 0.0), [50, 95, 99, 100], method="inverted_cdf")
        delays_s = (timing.delay_p50_s, timing.delay_p95_s, timing.delay_p99_s, timing.delay_max_s)
        assert delays_s == tuple(reference)
        assert (timing.steps, timing.late) == (count, int((delays > STEP_S).sum()))
    empty = StepClock(STEP_S).summary()
    assert (empty.steps, empty.late_share, empty.delay_max_s) == (0, 0.0, 0.0)


def ended(
    limit_s: float, spend: Callable[[Host, float], None], agent_cores: float = 0.0, **pace: float
) -> tuple[StopSession, StepTiming]:
    """A session in real time, on a host of which `spend` takes time after each step, at this simulated moment."""
    host, records = Host(), list[Record]()
    spec = session_simspec(pace=Pace(mode="realtime", **pace), mission=Mission(time_limit_s=limit_s))
    with session_of(spec, host, FakeAgent(host), records) as (session, vehicle):

        def receive() -> dict[str, int]:
            spend(host, vehicle.time.s)
            host.usage = AgentUsage(cpu_s=agent_cores * host.now_s)
            return {}

        vehicle.receive = receive  # type: ignore[method-assign]
        with pytest.raises(StopSession) as end:
            session.run()
        timing = fact_of(session._progress.facts, StepTiming)
    assert timing is not None
    assert str(end.value.outcome).encode() in records[-1].data
    return end.value, timing


def flown(
    stalls: dict[float, float], agent_cores: float = 0.0, **pace: float
) -> tuple[StopSession, StepTiming]:
    """Four seconds, on a host that stalls at these simulated moments for so long."""
    return ended(4.0, lambda host, at_s: host.spend(stalls.get(round(at_s, 2), 0.0)), agent_cores, **pace)


def test_a_stall_makes_the_steps_behind_it_late_until_the_bench_has_caught_up() -> None:
    """A stall of 0.11 s at 1 s, and one of 0.05 s at 2 s: due and made moments by hand."""
    end, timing = flown({1.0: 0.11, 2.0: 0.05})
    assert end.outcome is Outcome.TIME_LIMIT
    # The step that stalls has its own 20 ms. Behind the first: delays of 90, 70, 50, 30 and 10 ms, the last within a
    # step; behind the second: 30 and 10 ms.
    assert (timing.steps, timing.late, timing.late_after_s) == (200, 5, STEP_S)
    assert timing.delay_max_s == pytest.approx(0.09)
    assert timing.delay_p50_s == timing.delay_p95_s == pytest.approx(0.0)


def test_a_host_that_is_late_too_often_ends_the_session_as_too_slow() -> None:
    """More than the share that the SimSpec allows, and never the agent's fault unless it used up the host itself."""
    stalls = {1.0: 0.15, 3.0: 0.15}
    end, timing = flown(stalls)
    assert (end.outcome, timing.late) == (Outcome.BENCH_TOO_SLOW, 12)
    assert "12 of 200 steps (6.0%) were late by more than 20 ms" in end.reason
    assert "pace.max_late_share is 5.0%" in end.reason
    assert "had ended as time_limit: the time limit of 4 s is reached" in end.reason
    assert flown(stalls, max_late_share=0.06)[0].outcome is Outcome.TIME_LIMIT
    assert flown(stalls, max_late_share=0.059)[0].outcome is Outcome.BENCH_TOO_SLOW


def test_an_agent_that_keeps_every_core_busy_cannot_drop_its_session(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charged above half of the processor time of the host, here with two cores and with eight."""
    stalls = {1.0: 0.15, 3.0: 0.15}
    for cores in (2, 8):
        monkeypatch.setattr("bench.simulation._real_time.usable_cores", lambda cores=cores: float(cores))
        assert flown(stalls, agent_cores=0.5 * cores - 0.01)[0].outcome is Outcome.BENCH_TOO_SLOW
        end, _ = flown(stalls, agent_cores=0.5 * cores + 0.05)
        assert end.outcome is Outcome.AGENT_TIMEOUT
        assert "of the host's processor time" in end.reason
        assert flown({}, agent_cores=float(cores))[0].outcome is Outcome.TIME_LIMIT


def test_the_cores_of_a_session_are_those_that_it_may_use(tmp_path: Path) -> None:
    """A job or a container on a large machine: limits of its control groups count, the narrowest of them first."""
    own_group, groups = tmp_path / "cgroup", tmp_path / "groups"
    own_group.write_text("1:name=systemd:/\n0::/slurm/job\n")
    (groups / "slurm" / "job").mkdir(parents=True)
    allowed = len(os.sched_getaffinity(0))
    assert usable_cores(groups, own_group) == usable_cores(groups, tmp_path / "missing") == allowed
    (groups / "slurm" / "job" / "cpu.max").write_text("max 100000\n")
    assert usable_cores(groups, own_group) == allowed
    (groups / "slurm" / "cpu.max").write_text("50000 100000\n")
    assert usable_cores(groups, own_group) == 0.5
    (groups / "slurm" / "job" / "cpu.max").write_text("25000 100000\n")
    assert usable_cores(groups, own_group) == 0.25


@pytest.mark.parametrize("seed", range(3))
def test_late_steps_without_input_are_those_of_a_session_without_it(seed: int) -> None:
    """Beside a second session that spends the same on everything else, and sleeps whenever it is early."""
    random = np.random.default_rng(seed)
    spent_s, input_s = random.exponential(0.012, 2000), random.exponential(0.012, 2000)
    clock, late, delay_s, without_s = StepClock(STEP_S), 0, 0.0, 0.0
    for own_s, taken_s in zip(spent_s, input_s, strict=True):
        delay_s = max(delay_s + own_s + taken_s - STEP_S, 0.0)
        without_s = max(without_s + own_s - STEP_S, 0.0)
        late += without_s > STEP_S
        clock.record(delay_s, taken_s)
    timing = clock.summary()
    assert timing.late_without_input == late
    assert 0 < late < timing.late


def flooded(
    taken_s: float, read_s: float, host_s: float, readers: float = 1.0, agent_cores: float = 0.0
) -> tuple[StopSession, int]:
    """A session whose first four simulated seconds of eight an agent spoils: at every second step the bench takes `taken_s`
    to take in what it sends, has no core for `read_s` because the air network reads it with `readers` threads' worth of
    CPU time, and loses `host_s` to other programs.
    """

    def spend(host: Host, at_s: float) -> None:
        if at_s < 4.0 and round(at_s / STEP_S) % 2:
            host.spend(taken_s + read_s + host_s)
            host.thread_cpu_s += taken_s
            host.thread_starved_s += read_s + host_s
            host.air_readers_cpu_s += read_s * readers

    end, timing = ended(8.0, spend, agent_cores)
    assert timing.late_without_input is not None
    return end, timing.late_without_input


def test_an_agent_that_floods_the_bench_cannot_drop_its_session(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charged by what its messages cost the bench, by either way; not for ordinary ones on a host that is slow anyway."""
    monkeypatch.setattr("bench.simulation._real_time.usable_cores", lambda: 8.0)
    for taken_s, read_s in ((0.05, 0.0), (0.0, 0.05), (0.025, 0.025)):
        end, without = flooded(taken_s, read_s, 0.0)
        assert (end.outcome, without) == (Outcome.AGENT_FLOODED, 0)
        assert "without what it sent 0 steps had been late, but " in end.reason
        assert "had ended as time_limit" in end.reason
    # The same by other programs alone, or by far the most of it.
    for taken_s, read_s, host_s in ((0.0, 0.0, 0.05), (0.004, 0.004, 0.05)):
        end, without = flooded(taken_s, read_s, host_s)
        assert end.outcome is Outcome.BENCH_TOO_SLOW
        assert without > 100
    # The air network had a core for a tenth of the time in which the session had none: others had it for the rest.
    assert flooded(0.0, 0.05, 0.0, readers=0.1)[0].outcome is Outcome.BENCH_TOO_SLOW


def test_the_bench_s_work_on_input_counts_with_the_agent_s_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """The agent has 0.4 of the only core, and the air network reads for 1.5 s of eight; or 0.3 of it."""
    monkeypatch.setattr("bench.simulation._real_time.usable_cores", lambda: 1.0)
    for cores, outcome in ((0.4, Outcome.AGENT_TIMEOUT), (0.3, Outcome.BENCH_TOO_SLOW)):
        end, _ = flooded(0.0, 0.015, 0.035, agent_cores=cores)
        assert end.outcome is outcome


def test_short_sessions_and_bench_errors_stay_as_they_are() -> None:
    def timing(steps: int) -> StepTiming:
        clock = StepClock(STEP_S)
        for _ in range(steps):
            clock.record(1.0)
        return clock.summary()

    crashed = StopSession(Outcome.AGENT_CRASHED, "exit code 1")
    assert judged(crashed, timing(MIN_JUDGED_STEPS - 1), Pace(), 0.0) is crashed
    assert judged(crashed, timing(MIN_JUDGED_STEPS), Pace(), 0.0).outcome is Outcome.BENCH_TOO_SLOW
    fault = StopSession(Outcome.BENCH_ERROR, "no memory")
    assert judged(fault, timing(MIN_JUDGED_STEPS), Pace(), 0.0) is fault


def test_the_report_states_late_steps_jitter_and_losses() -> None:
    def run(name: str, late: int, p99_s: float, outcome: Outcome, **losses: int) -> Run:
        delays_s = dict(zip(("p50", "p95", "p99", "max"), (0.0, 0.001, p99_s, 0.1), strict=True))
        delays = {f"delay_{name}_s": delay_s for name, delay_s in delays_s.items()}
        timing = StepTiming(steps=1000, late=late, late_after_s=STEP_S, **delays)
        return Run(name, "p001", 1, "one", None, outcome, facts=facts_of(timing), losses=losses)

    def facts(*runs: Run) -> dict[str, str]:
        data = ReportData("x", "", (), (), runs, {}, (), pl.DataFrame(), {}, (), {}, {}, "d", None, {})
        return {fact.name: fact.text for fact in campaign_facts(data)}

    lockstep = Run("c", "p001", 3, "one", None, Outcome.COMPLETED, losses={"bytes lost": 5})
    told = facts(
        run("a", 3, 0.004, Outcome.COMPLETED, **{"bytes lost": 2}),
        run("b", 90, 0.03, Outcome.BENCH_TOO_SLOW, **{"bytes lost": 7, "resets": 1}),
        lockstep,
    )
    assert told["Real time"] == (
        "93 of 2,000 steps in 2 runs were late, at most 9.0% in one run; 99 % of the steps of each run began at most "
        "30.0 ms late; 1 run too slow to count"
    )
    assert told["Losses on links in real time"] == "9 bytes lost, 1 resets"
    assert "Real time" not in facts(lockstep)
