"""What the parts of a session tell beside its recording: one typed document each, and `result.json` holds them all.

A new fact is a class here. The part that knows it hands it on as a value, and readers ask the result for the class.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import AfterValidator, BeforeValidator, GetJsonSchemaHandler, SerializeAsAny, ValidationError
from pydantic_core import CoreSchema

from bench.documents import Document
from bench.visible_text import visible

# Words of agents, vehicles and files are in it: of a process that crashed, a firmware's console, a report.
Words = Annotated[str, AfterValidator(visible)]

_KINDS: dict[str, type[Fact]] = {}


class Fact(Document):
    """One thing that a part of a session tells. `key` is its name in `result.json`."""

    key: ClassVar[str]

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if "key" in vars(cls):
            _KINDS[cls.key] = cls


AnyFact = TypeVar("AnyFact", bound=Fact)


def facts_of(*facts: Fact) -> dict[str, Fact]:
    """These facts by their keys."""
    return {fact.key: fact for fact in facts}


def fact_of(facts: Mapping[str, Fact], kind: type[AnyFact]) -> AnyFact | None:
    """The fact of this kind; None where no part told it."""
    fact = facts.get(kind.key)
    return fact if isinstance(fact, kind) else None


def _read_facts(stored: object) -> dict[str, Fact]:
    """Facts from plain values. One that no class knows, or that was edited until it fits none, reads as absent."""
    facts: dict[str, Fact] = {}
    for key, value in stored.items() if isinstance(stored, Mapping) else ():
        if isinstance(value, Fact):
            facts[key] = value
        elif kind := _KINDS.get(key):
            # Before facts were documents, those of one field stood as its value.
            if not isinstance(value, Mapping) and len(kind.model_fields) == 1:
                value = dict.fromkeys(kind.model_fields, value)
            with suppress(ValidationError):
                facts[key] = kind.model_validate(value)
    return facts


class _SchemaByKey:
    """The JSON Schema of facts: each kind under its key."""

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        for kind in _KINDS.values():
            kind.model_rebuild()
        properties = {key: handler(kind.__pydantic_core_schema__) for key, kind in sorted(_KINDS.items())}
        return {"type": "object", "properties": properties}


Facts = Annotated[dict[str, SerializeAsAny[Fact]], BeforeValidator(_read_facts), _SchemaByKey()]


class Texts(Fact):
    """Facts that are texts, one for each time that something happened."""

    texts: tuple[Words, ...]


class SuspectEnds(Texts):
    """How the attempts ended that an unconfined agent may have caused."""

    key = "suspect"


class TruthSightings(Texts):
    """The reports of honeypots."""

    key = "saw_the_truth"


class ReportStatement(Document):
    """What one report states, and how far it was off. `error_m` is the distance to the nearest target of its class, None
    without one; `sigma_m` the stated error, one sigma on each axis.
    """

    confidence: float
    error_m: float | None
    sigma_m: float | None


class ReportStatements(Fact):
    """What the reports of the run state of their confidence and error, in order of arrival."""

    key = "report_statements"
    reports: tuple[ReportStatement, ...]


class FirmwareEnds(Texts):
    """How the real autopilot failed in flight in attempts at the run."""

    key = "firmware_ended"


class BenchTraceback(Fact):
    """Where the bench failed."""

    key = "traceback"
    text: Words


class TruthGiven(Fact):
    """The bench gave the agent the truth, as an oracle needs it."""

    key = "truth"
    agent: Words


class Software(Fact):
    """Software beside the bench that had a part in the session, with its version or digest as far as it tells."""

    description: Words


class PixelDetectorBuild(Software):
    """The detector that worked on the pictures."""

    key = "detector"


class FirmwareBuild(Software):
    """The real autopilot that flew, with its pace; absent where one is imitated."""

    key = "firmware"


class WarpLibrary(Software):
    """The library by which the agent's clock was the session's; absent at the other paces."""

    key = "warp"


class Arithmetic(Fact):
    """What the last bits of the recording depend on beside the versions in its head."""

    key = "arithmetic"
    processor: Words
    libm: Words
    blas: Words


class Confinement(Fact):
    """How the host confined the agent: the rung, and whose network the agent had ("own", or why the host's).

    `open_walls` are the names of the walls that the rung did not hold there, known once the agent has started; None:
    it never did.
    """

    key = "confinement"
    isolation: Words
    network: Words
    open_walls: tuple[Words, ...] | None = None


class AgentCache(Fact):
    """What the agent's cache held: the digest of names, links, modes and contents; absent for a manifest without one."""

    key = "agent_cache"
    sha256: Words
    files: int
    size_bytes: int


class UnreadTopics(Fact):
    """What the agent was told, to which it never subscribed. A subscription with a wrong type or hash is none, and silent."""

    key = "unread_topics"
    topics: tuple[Words, ...]


class UnmatchedTopics(Fact):
    """What the agent announced of an autopilot's topics and this session does not have, each in a sentence."""

    key = "unmatched_topics"
    sentences: tuple[Words, ...]


class AgentExit(Fact):
    """How the agent's process ended the session: its exit code, or minus the signal that killed it."""

    key = "agent_exit_code"
    code: int


class OverheadFidelity(Fact):
    """A surrogate took the place of the session, and these observables are not computed by it."""

    key = "overhead"
    not_computed: tuple[Words, ...]


class ServiceUse(Document):
    """What went over one service that the SimSpec let in. Bytes are the agent's: sent to the service, received from it.

    `failed` connections were not taken by the service, `refused` ones not by the bench: too many at once. Without
    `counted` the process that carries connections was gone before it could tell, and the numbers are 0.
    """

    name: Words
    host: Words
    port: int
    connections: int = 0
    failed: int = 0
    refused: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    counted: bool = True

    def __str__(self) -> str:
        where = f"{self.name} ({self.host}:{self.port})"
        if not self.counted:
            return f"{where}, not counted"
        lost = [
            f", {count:,} {word}"
            for count, word in ((self.failed, "failed"), (self.refused, "refused"))
            if count
        ]
        connections = f"{self.connections:,} connection{'' if self.connections == 1 else 's'}"
        return f"{where}, {connections}{''.join(lost)}, {self.bytes_sent:,} bytes sent and {self.bytes_received:,} received"


class ServicesLetIn(Fact):
    """What went over the services that the SimSpec let in."""

    key = "services"
    uses: tuple[ServiceUse, ...]


class StepTiming(Fact):
    """How punctually a session in real time began its steps. A delay is counted from the moment at which a step was due;
    percentiles of delays are its jitter. A step is late when it began more than `late_after_s`, its own length, too late:
    what the agent sent for it was then taken by another step. `late_without_input` is how many would have been late if the
    bench had had nothing to do with what the agent sends, and `late_input_share` which part of the host's time between two
    steps, of which the second was late, that work took; None where it was not counted.
    """

    key = "timing"
    steps: int
    late: int
    late_after_s: float
    delay_p50_s: float
    delay_p95_s: float
    delay_p99_s: float
    delay_max_s: float
    late_without_input: int | None = None
    late_input_share: float | None = None

    @property
    def late_share(self) -> float:
        """Late steps among all; 0 without steps."""
        return self.late / self.steps if self.steps else 0.0

    def __str__(self) -> str:
        return (
            f"{self.late:,} of {self.steps:,} steps ({self.late_share:.1%}) were late by more than "
            f"{self.late_after_s * 1e3:g} ms; delays: half up to {self.delay_p50_s * 1e3:.1f} ms, 95 % up to "
            f"{self.delay_p95_s * 1e3:.1f} ms, 99 % up to {self.delay_p99_s * 1e3:.1f} ms, largest "
            f"{self.delay_max_s * 1e3:.1f} ms"
        )
