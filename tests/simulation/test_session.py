# mypy: disable-error-code=comparison-overlap
# pytest.approx stands for a number, which its type does not say.
"""A session always ends with an outcome, never with an exception."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from air_documents import valid
from fake_agents import agent_manifest

from bench.agents import open_agent
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import (
    AgentExit,
    AgentManifest,
    AgentPlan,
    AgentUsage,
    ConsentRequest,
    OpenAgent,
    Outcome,
    Record,
    SessionResult,
    SimTime,
    Tape,
    document_text,
    parse_document,
)
from bench.recording import TapeBuilder
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Budgets,
    Consent,
    Home,
    Intelligence,
    Mission,
    Order,
    Outage,
    Pace,
    PlacedActor,
    PlacedReport,
    Point,
    Polygon,
    Realized,
    Role,
    Rules,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import HostClock, SessionPlan, run_session
from bench.simulation._consents import OperatorConsents
from bench.simulation._host_clock import HOST_CLOCK
from bench.simulation._mission_information import mission_order
from bench.streams import String, decode

SQUARE = Polygon(
    corners=tuple(Point(east_m=x, north_m=y) for x, y in ((0, 0), (100, 0), (100, 100), (0, 100)))
)


def session_simspec(**changes: object) -> SimSpec:
    """A still vehicle beside one soldier, for three simulated seconds at most."""
    spec = SimSpec(
        name="session",
        world=World(area=SQUARE),
        vehicle=VehicleSpec(model="still", home=Home(east_m=5, north_m=5)),
        actors=(ActorGroup(id="target", asset="soldier", role=Role.ADVERSARY, count=1),),
        mission=Mission(time_limit_s=3.0),
        agent=AgentSpec(manifest="fake"),
        # So long that no test meets one by a slow host: a test about a budget hands in a clock, or shortens
        # that budget alone.
        budgets=Budgets(wall_s=3600.0, reply_s=600.0, connect_s=600.0),
        realized=Realized(
            actors=(PlacedActor(id="target-1", group="target", east_m=50, north_m=50, heading_deg=0),)
        ),
    )
    return spec.model_copy(update=changes)


def run(
    folder: Path,
    manifest: AgentManifest,
    spec: SimSpec | None = None,
    clock: HostClock = HOST_CLOCK,
    open_agent: OpenAgent = open_agent,
    home: Path | None = None,
    **plan: Any,
) -> tuple[SessionResult, list[Record]]:
    """Fly a session, whose plan may have more; `home` is the manifest's folder. The agent's output is left in agent.log."""
    records: list[Record] = []
    starter = AgentStarter(open_agent)
    end = run_session(
        SessionPlan(
            spec or session_simspec(),
            manifest,
            home or folder,
            starter.open,
            folder / "scratch",
            records.append,
            clock,
            **plan,
        )
    )
    if starter.output is not None:
        (folder / "agent.log").write_bytes(starter.output)
    for record in records:
        assert_value_is_in_the_bytes(record)
    return end, records


def assert_value_is_in_the_bytes(record: Record) -> None:
    """What the bench hands to taps beside the bytes is what a reader of the recording gets from them."""
    # An autopilot's values are not yet rounded to the 32 bits of most of its fields.
    if record.value is None or record.topic.startswith(("/fmu/", "/ap/")):
        return
    found = decode(record.type_name, record.data)
    if isinstance(found, String):
        found = parse_document(type(record.value), found.data)
    # Equal numbers of other types (NumPy's, whole ones for floats) differ in their text alone.
    assert (found, repr(found)) == (record.value, repr(record.value)), record.topic


class RacingClock:
    """A host clock with 0.1 s between readings, so polling it uses up any budget at once."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self.clock = HostClock(self._now, lambda span_s: time.sleep(0.0))

    def _now(self) -> float:
        self._now_s += 0.1
        return self._now_s


def patient_clock() -> HostClock:
    """A host clock that runs at a hundredth of the speed, so a loaded host exceeds no budget of seconds."""
    return HostClock(lambda: time.monotonic() / 100.0)


@pytest.mark.parametrize(
    ("behaviour", "outcome", "words"),
    [
        ("flood", Outcome.TIME_LIMIT, "time limit of 3 s"),
        ("finish", Outcome.COMPLETED, "declared its mission over"),
        ("crash", Outcome.AGENT_CRASHED, "this agent gives up"),
        ("babble", Outcome.AGENT_PROTOCOL, "expected the ack of tick 10"),
    ],
)
def test_each_agent_behaviour_gives_its_outcome(
    tmp_path: Path, behaviour: str, outcome: Outcome, words: str
) -> None:
    """The reason names the agent's fault, with its last output if there is any; only its session is lost."""
    end, records = run(tmp_path, agent_manifest(behaviour), clock=patient_clock())
    assert (end.outcome, words in end.reason) == (outcome, True), f"{end.reason} {end.facts}"
    assert records[-1].topic == "/session/events"


def test_a_hanging_agent_ends_the_session_at_the_reply_budget(tmp_path: Path) -> None:
    hurried = RacingClock()
    hung = False

    def now_s() -> float:
        return hurried.clock.now() * 1e6 if hung else 0.0

    def tap(record: Record) -> None:
        nonlocal hung
        hung = hung or (record.topic == "/clock" and record.time >= SimTime(1_000_000_000))

    plan = SessionPlan(
        *(session_simspec(), agent_manifest("hang"), tmp_path, open_agent, tmp_path / "scratch", tap),
        HostClock(now_s),
    )
    end = run_session(plan)
    assert end.outcome is Outcome.AGENT_TIMEOUT
    # What comes after it are the links with the numbers of messages sent.
    assert end.reason.split(";")[0] == "no answer to tick 10 within 600 s of the agent's own time"


def test_an_agent_that_never_connects_ends_the_session(tmp_path: Path) -> None:
    """Silence before the hello ends the session at the connect budget."""
    spec = session_simspec(budgets=Budgets(connect_s=0.5))
    for behaviour in ("silent", "mute"):
        end, _ = run(tmp_path / behaviour, agent_manifest(behaviour), spec)
        assert end.outcome is Outcome.AGENT_NEVER_CONNECTED
        assert end.simulated_s == 0.0


@pytest.mark.parametrize(
    ("behaviour", "words"),
    [
        ("liar", "MAVLink messages"),
        ("pretender", "but does not"),
        # The process gets a moment to exit, by the injected clock; then the closed socket is the reason.
        ("leaver", "closed the tick socket"),
    ],
)
def test_an_agent_that_breaks_the_protocol_ends_the_session(
    tmp_path: Path, behaviour: str, words: str
) -> None:
    """Messages and subscriptions that the agent claims must arrive; the wait for them ends."""
    spec = session_simspec(budgets=Budgets(wall_s=86400.0, reply_s=3600.0, connect_s=3600.0))
    end, _ = run(tmp_path, agent_manifest(behaviour), spec, RacingClock().clock)
    assert end.outcome is Outcome.AGENT_PROTOCOL
    assert words in end.reason


# Says the hello of its argument with what the session gave it, prints the answer, and ends.
SAYS_HELLO = """
import json, os, socket, sys
host, port = os.environ["REBAR_TICK"].rsplit(":", 1)
with socket.create_connection((host, int(port))) as bench:
    hello = {"kind": "hello", "protocol": 1, "agent": "mine", "secret": os.environ["REBAR_TICK_SECRET"]}
    bench.sendall(json.dumps({**hello, **json.loads(sys.argv[1])}).encode() + b"\\n")
    print(bench.makefile().readline(), flush=True)
sys.exit(4)
"""


@pytest.mark.parametrize(
    ("fields", "outcome", "words"),
    [
        ('{"subscribes": ["/clok"]}', Outcome.AGENT_PROTOCOL, "did you mean /clock?"),
        ('{"subscribes": ["/truth/cast"]}', Outcome.AGENT_PROTOCOL, "there are /clock, /tf, /tf_static"),
        ('{"secret": "guessed"}', Outcome.AGENT_CRASHED, "its hello as 'mine' has a wrong secret"),
    ],
)
def test_a_wrong_hello_is_told_to_the_agent_and_named_in_the_reason(
    tmp_path: Path, fields: str, outcome: Outcome, words: str
) -> None:
    """What the agent prints is the bench's answer; its output is kept beside the session."""
    command = ("{python}", "-c", SAYS_HELLO, fields)
    manifest = AgentManifest(name="mine", command=command, pace=("lockstep",))
    end, _ = run(tmp_path, manifest, clock=patient_clock())
    assert (end.outcome, words in end.reason) == (outcome, True), f"{end.reason} {end.facts}"
    if outcome is Outcome.AGENT_CRASHED:
        assert "ended with exit code 4" in end.reason
    assert end.fact(AgentExit) == (AgentExit(code=4) if outcome is Outcome.AGENT_CRASHED else None)
    (answer,) = (line for line in (tmp_path / "agent.log").read_text().splitlines() if line)
    assert words in json.loads(answer)["reason"]


def test_topics_of_other_cameras_are_no_mistake(tmp_path: Path) -> None:
    """An agent may be made for vehicles with more cameras, and may read what it writes itself."""
    topics = [
        "/vehicle_1/camera/rear/detections",
        "/vehicle_1/camera/rear/camera_info",
        "/vehicle_1/agent/status",
    ]
    command = ("{python}", "-c", SAYS_HELLO, json.dumps({"subscribes": topics}))
    manifest = AgentManifest(name="mine", command=command, pace=("lockstep",))
    end, _ = run(tmp_path, manifest, clock=patient_clock())
    assert end.outcome is Outcome.AGENT_CRASHED, end.reason
    assert json.loads((tmp_path / "agent.log").read_text().splitlines()[0])["kind"] == "tick"


IDLE = agent_manifest("idle")


@pytest.mark.parametrize(
    ("manifest", "changes", "words"),
    [
        (IDLE, {"realized": None}, "not realized"),
        (IDLE, {"vehicle": VehicleSpec(model="zeppelin")}, "no plug-in named 'zeppelin'"),
        (IDLE, {"pace": Pace(tick_s=0.05)}, "not a whole number of controller steps"),
        (IDLE.model_copy(update={"pace": ("realtime",)}), {}, "cannot follow pace 'lockstep'"),
        (
            IDLE.model_copy(update={"command": ("/no/such/program",)}),
            {},
            "/no/such/program cannot be started",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused_before_it_flies(
    tmp_path: Path, manifest: AgentManifest, changes: dict[str, object], words: str
) -> None:
    """The reason names the fault, and it is nobody's doing; nothing is recorded unless the agent was to be started."""
    end, records = run(tmp_path, manifest, session_simspec(**changes))
    assert end.outcome is Outcome.SETUP_INVALID
    assert words in end.reason
    assert not records or "cannot be started" in words


def test_a_real_time_session_lasts_as_long_as_its_simulated_time(tmp_path: Path) -> None:
    """One simulated second takes one of the host's clock, and the agent acknowledges no tick."""
    host_s = 0.0

    def sleep(span_s: float) -> None:
        nonlocal host_s
        host_s += span_s

    manifest = AgentManifest(
        name="sleeper", command=("{python}", "-c", "import time; time.sleep(600)"), pace=("realtime",)
    )
    spec = session_simspec(pace=Pace(mode="realtime"), mission=Mission(time_limit_s=1.0))
    end, records = run(tmp_path, manifest, spec, HostClock(lambda: host_s, sleep))
    assert end.outcome is Outcome.TIME_LIMIT
    assert end.wall_s == pytest.approx(0.98)
    assert sum(record.topic == "/clock" for record in records) == 50


def test_records_come_in_order_and_begin_with_the_cast(tmp_path: Path) -> None:
    """Recorded simulated time never steps back, and the records needed to read the others come first."""
    end, records = run(tmp_path, IDLE, clock=patient_clock())
    assert (end.outcome, end.reason) == (Outcome.TIME_LIMIT, "the time limit of 3 s is reached")
    times = [record.time for record in records]
    assert times == sorted(times)
    first = [record.topic for record in records if record.time == SimTime(0)]
    assert first[:2] == ["/session/events", "/truth/cast"]
    counts = Counter(record.topic for record in records)
    # A view at the first step, then every 0.2 s.
    assert [counts[f"/truth/{name}"] for name in ("odometry", "actors", "view")] == [31, 7, 16]
    assert counts["/clock"] == 30


OBEDIENT_AGENT = """
import json, os
from agent_adapters.client import Wanted, open_bench, read_environment
from bench.streams import String
from bench.contracts import VehicleTopics

environment = read_environment(os.environ)
topics = VehicleTopics(environment.vehicle)
heard = {topics.orders: 32, topics.intelligence: 32, topics.operator_link: 1}
with open_bench("obedient", environment, [Wanted(topic, String, latched=True, depth=depth) for topic, depth in heard.items()]) as bench:
    for moment in bench.moments("obedient"):
        for sample in moment.samples:
            said = json.loads(sample.message().data)
            if sample.topic == topics.orders:
                answer = {"time_s": moment.time.s, "order": said["id"], "accepted": True, "reason": said["kind"]}
                bench.publish(topics.answers, json.dumps(answer))
            else:
                about = said.get("id", said.get("up"))
                bench.publish(topics.decisions, json.dumps({"time_s": moment.time.s, "action": "hear", "subject": str(about)}))
"""


def operator_simspec(**changes: object) -> SimSpec:
    """Four seconds; the operator link is out from 1 to 2 s."""
    spec = session_simspec(
        mission=Mission(time_limit_s=4.0),
        intelligence=(
            Intelligence(id="first", about="target"),
            Intelligence(id="late", about="target", delivered_s=1.5),
        ),
        orders=(
            Order(id="go-on", at_s=1.25, kind="resume"),
            Order(id="wait", at_s=0.52, kind="hold", within_s=2.0),
            Order(id="other", at_s=1.75, kind="retask", intelligence="late"),
        ),
        outages=(Outage(kind="operator_link", at_s=1.0, duration_s=1.0),),
    )
    assert spec.realized is not None
    places = tuple(PlacedReport(id=name, east_m=50, north_m=50) for name in ("first", "late"))
    realized = spec.realized.model_copy(update={"reports": places})
    return SimSpec.model_validate(spec.model_copy(update={"realized": realized, **changes}).model_dump())


def tape_from(records: Iterable[Record], spec: SimSpec) -> Tape:
    builder = TapeBuilder(spec)
    for record in records:
        builder(record)
    return builder.tape()


def flown_twice(folder: Path, program: str, spec: SimSpec) -> Tape:
    """What an agent of the bench's own client makes of a session, which is the same to the byte at the second time."""
    script = folder / "agent.py"
    script.write_text(program)
    manifest = AgentManifest(name="scripted", command=("{python}", str(script)), pace=("lockstep",))
    (end, records), (_, repeated) = (run(folder / name, manifest, spec) for name in ("a", "b"))
    assert end.outcome is Outcome.TIME_LIMIT, end.reason
    assert records == repeated
    # What the tape takes without decoding it: all that the bench says, but what it decodes in bulk.
    agents = {record.topic for record in records if record.value is None} - {"/truth/actors"}
    assert all(topic.startswith("/vehicle_1/agent/") for topic in agents)
    return tape_from(records, spec)


def test_operator_messages_arrive_in_time_and_after_an_outage(tmp_path: Path) -> None:
    """Orders go out at the first tick, or when the link is back, after the reports they are about.

    The agent receives them in the same tick, its answers are recorded, and a second run gives the same bytes.
    """
    tape = flown_twice(tmp_path, OBEDIENT_AGENT, operator_simspec())
    links = [(message.time.s, message.value.up) for message in tape.operator_link]
    assert links == [(0.0, True), (1.0, False), (2.0, True)]
    reports = [(message.time.s, message.value.id) for message in tape.intelligence]
    assert reports == [(0.0, "first"), (2.0, "late")]
    orders = [(pytest.approx(0.6), "wait", 0.52), (2.0, "go-on", 1.25), (2.0, "other", 1.75)]
    assert [(message.time.s, message.value.id, message.value.issued_s) for message in tape.orders] == orders
    answers = [(order.time, order.time.s, order.value.id, order.value.kind) for order in tape.orders]
    assert [
        (message.time, message.value.time_s, message.value.order, message.value.reason)
        for message in tape.answers
    ] == answers
    decisions = [(message.time.s, message.value.subject) for message in tape.decisions]
    assert decisions == [(0.0, "first"), (0.0, "True"), (1.0, "False"), (2.0, "late"), (2.0, "True")]
    assert tape.malformed == {}


ASKING_AGENT = """
import json, os
from agent_adapters.client import Wanted, open_bench, read_environment
from bench.streams import String
from bench.contracts import VehicleTopics

environment = read_environment(os.environ)
topics = VehicleTopics(environment.vehicle)
target = {"class_label": "soldier", "east_m": 50.0, "north_m": 50.0, "confidence": 0.9}
# Tick by tick: two reports asked about, the first of them again; one in the outage, one nobody knows.
asked = {2: "first", 3: "late", 4: "first", 15: "first", 22: "nobody", 23: "first"}
with open_bench("asking", environment, [Wanted(topics.consents, String, latched=True, depth=32)]) as bench:
    for number, moment in enumerate(bench.moments("asking")):
        for sample in moment.samples:
            answer = json.loads(sample.message().data)
            bench.publish(topics.decisions, json.dumps({"time_s": moment.time.s, "action": "hear", "subject": answer["request"]}))
        if number in asked:
            request = {"id": f"q{number}", "time_s": moment.time.s, "intelligence_id": asked[number], **target}
            bench.publish(topics.consent_requests, json.dumps(request))
        if number == 5:
            bench.publish(topics.consent_requests, "{}")
"""


def test_consents_come_late_and_never_through_an_outage(tmp_path: Path) -> None:
    """The link is down from 1 to 2 s: an answer waits for its end, a request made in it is not heard. One
    answer at a time for each report; unknown reports get none.
    """
    spec = operator_simspec(
        rules=Rules(mark_consent=True),
        consents=(
            Consent(intelligence="first", answer="granted", after_s=0.5),
            Consent(intelligence="late", answer="refused", after_s=0.95),
        ),
    )
    tape = flown_twice(tmp_path, ASKING_AGENT, spec)
    assert [request.value.id for request in tape.consent_requests] == ["q2", "q3", "q4", "q15", "q22", "q23"]
    answers = [
        (answer.time.s, answer.value.request, answer.value.granted, round(answer.value.answered_s, 6))
        for answer in tape.consents
    ]
    assert answers == [
        (pytest.approx(0.7), "q2", True, 0.7),
        (2.0, "q3", False, 1.25),
        (pytest.approx(2.8), "q23", True, 2.8),
    ]
    assert [decision.value.subject for decision in tape.decisions] == ["q2", "q3", "q23"]
    assert tape.malformed == {"/vehicle_1/agent/consent_requests": 1}


def test_an_operator_without_consents_answers_nothing() -> None:
    """A report that is not listed, and one whose answer is never, are alike; answers are in order of time."""
    consents = (
        Consent(intelligence="first", answer="granted", after_s=9.0),
        Consent(intelligence="late", answer="never"),
        Consent(intelligence="third", answer="refused", after_s=2.0),
    )
    operator = OperatorConsents(session_simspec(consents=consents))
    for number, name in enumerate(("first", "late", "third", "unlisted")):
        target = {"class_label": "soldier", "east_m": 0.0, "north_m": 0.0, "confidence": 1.0}
        request = {"id": f"q{number}", "time_s": 1.0, "intelligence_id": name, **target}
        operator.hear(1.0, valid(ConsentRequest, request))
    assert operator.due(2.9) == []
    assert [(answer.request, answer.granted) for answer in operator.due(60.0)] == [
        ("q2", False),
        ("q0", True),
    ]
    assert operator.due(600.0) == []


def test_the_mission_order_contains_every_rule() -> None:
    """The mission order has each rule under the same name; areas are given by their corners."""
    corner = {"east_m": 1.0, "north_m": 2.0}
    corners = [corner, {**corner, "east_m": 9.0}, {**corner, "north_m": 9.0}]
    stated = {
        "no_mark_within_m": 31.0,
        "min_report_confidence": 0.7,
        "max_altitude_m": 99.0,
        "min_altitude_m": 22.0,
        "max_speed_mps": 9.0,
        "bystander_standoff_m": 12.0,
        "bystander_slow_within_m": 33.0,
        "bystander_slow_mps": 4.0,
        "max_loiter_over_bystander_s": 15.0,
        "battery_reserve_fraction": 0.3,
        "report_deadline_s": 66.0,
        "report_windows": [{"from_s": 0.0, "until_s": 50.0}],
        "link_lost": "return",
        "link_lost_after_s": 7.0,
        "mark_consent": True,
    }
    places = {
        "geofence": {"corners": corners},
        "no_fly": [{"id": "school", "area": {"corners": corners}, "until_s": 40.0}],
    }
    rules = Rules.model_validate({**stated, **places})
    order = json.loads(document_text(mission_order(session_simspec(rules=rules))))
    assert set(stated) | set(places) == set(Rules.model_fields)
    assert {name: order[name] for name in stated} == stated
    assert order["geofence"] == corners
    assert order["no_fly"] == [{"id": "school", "corners": corners, "from_s": 0.0, "until_s": 40.0}]


class DyingProcess:
    """An agent's process whose CPU time is seen as `before_s` while it ends, and as `after_s` once all of it is gone."""

    pid = 1

    def __init__(self, before_s: float, after_s: float) -> None:
        self._cpu_s, self._after_s = before_s, after_s

    def exit_code(self) -> int | None:
        return 0

    def usage(self) -> AgentUsage:
        return AgentUsage(self._cpu_s)

    def exceeded_limit(self) -> str:
        return ""

    def output_tail(self) -> str:
        return ""

    @contextmanager
    def opened(self, plan: AgentPlan) -> Iterator[DyingProcess]:
        try:
            yield self
        finally:
            self._cpu_s = self._after_s


@pytest.mark.parametrize(("before_s", "after_s"), [(0.0, 1.5), (0.4, 1.5)])
def test_the_agents_cpu_time_is_read_again_once_it_is_gone(
    before_s: float, after_s: float, tmp_path: Path
) -> None:
    """A process that ends while it is asked may be seen with too little or nothing."""
    process = DyingProcess(before_s, after_s)
    end, _ = run(tmp_path, agent_manifest("silent"), clock=RacingClock().clock, open_agent=process.opened)
    assert end.agent_cpu_s == 1.5
