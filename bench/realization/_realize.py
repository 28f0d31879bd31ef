"""From a base SimSpec and a design to the SimSpecs that are flown."""

from __future__ import annotations

import json
import re
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.documents import validate_document
from bench.errors import Fault, SetupError
from bench.simspec import AgentSpec, PaceMode, SimSpec

from .design._design import Design, DesignPoint
from .design._factors import BASE, DesignFactor, FactorLevel
from .design._spec_paths import UNITS, SpecPath, find_path
from .design._stratified import Difficulties


@dataclass(frozen=True, slots=True)
class RealizationPlan:
    """One SimSpec to fly: which design point, replicate and agent it stands for. Nothing is placed yet.

    Plans of the same design point and replicate share every seed, hence the scene, whatever the agent. `situation` is
    that of the design point, which all its plans share; `pace` is the agent's own, None for that of the situation.
    """

    id: str
    design_point: str
    replicate: int
    levels: Mapping[str, FactorLevel]
    situation: SimSpec
    agent_spec: AgentSpec
    root_seed: int
    pace: PaceMode | None = None

    @property
    def simspec(self) -> SimSpec:
        """The SimSpec, made anew each time: kept, those of a large campaign would take ten times the plans."""
        seeds = self.situation.seeds.model_copy(update={"root": self.root_seed})
        pace = self.situation.pace
        if self.pace is not None:
            pace = pace.model_copy(update={"mode": self.pace})
        # A base may come with places of its own; they belong to other seeds, so they are dropped.
        own = {"name": self.id, "agent": self.agent_spec, "seeds": seeds, "realized": None, "pace": pace}
        return self.situation.model_copy(update=own)

    @property
    def agent(self) -> str:
        """The agent's label."""
        return self.agent_spec.label


Rating = Callable[[SimSpec], Mapping[str, float | None]]
"""Rates a situation: the difficulty of each studied node, None where it has none.

Callers hand it in, because this package knows no decompositions.
"""

Bases = SimSpec | Mapping[str, SimSpec]
"""What a design varies: one base SimSpec, or several by name, one for each level of the factor that sets
`base`.
"""


def realize(
    base: Bases, design: Design, agents: Sequence[AgentSpec], rate: Rating | None = None
) -> list[RealizationPlan]:
    """Every realization of a design, agents of one scene next to each other.

    Raises SetupError naming factor, path and remedy when a factor's path leads nowhere or a level does not
    fit. `rate` is used when the design is drawn by difficulty (`Design.rated`).
    """
    labels = _labels(agents)
    patches = _Patches.of(base, design)
    pairs = _pairs(patches, rate)
    scenes = {point.id: patches.apply(point) for point in {point.id: point for point, _ in pairs}.values()}
    return [
        RealizationPlan(
            f"{point.id}-r{replicate}-{label}",
            point.id,
            replicate,
            point.levels,
            scenes[point.id],
            agent,
            scene_seed(design.seed, point.scene, replicate),
        )
        for point, replicate in pairs
        for agent, label in zip(agents, labels, strict=True)
    ]


def design_pairs(base: Bases, design: Design, rate: Rating | None = None) -> list[tuple[DesignPoint, int]]:
    """The (point, replicate) pairs of a design over its bases, drawn by difficulty if the design says so.

    Raises as `realize` does, but checks levels only when the design is drawn by difficulty.
    """
    return _pairs(_Patches.of(base, design), rate) if design.rated else design.pairs()


def situations(base: Bases, design: Design, points: Sequence[DesignPoint]) -> list[SimSpec]:
    """The base SimSpec with the levels of each of these points, nothing placed; raises as `realize` does."""
    patches = _Patches.of(base, design)
    return [patches.apply(point) for point in points]


def _pairs(patches: _Patches, rate: Rating | None) -> list[tuple[DesignPoint, int]]:
    design = patches.design
    if not design.rated:
        return design.pairs()
    try:
        return design.pairs(patches.rated(rate))
    # The author of the design can fix it.
    except ValueError as error:
        raise SetupError("design: method", str(error)) from None


def scene_seed(seed: int, design_point: str, replicate: int) -> int:
    """The 63-bit root seed of one scene; it depends on nothing else, so later points change no scene."""
    # CRC-32 instead of hash(): Python salts the hash of a string in every process.
    sequence = np.random.SeedSequence([seed, zlib.crc32(design_point.encode()), replicate])
    # 63 bits: the SimSpec's seeds are below 2**63.
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def _labels(agents: Sequence[AgentSpec]) -> list[str]:
    # Labels become part of realization ids, which name files.
    labels = [re.sub(r"[^a-z0-9_-]+", "-", agent.label.lower()) for agent in agents]
    twice = [label for label, times in Counter(labels).items() if times > 1]
    long = [label for label in labels if len(label) > 40]
    what = remedy = ""
    if not agents:
        what, remedy = "no agent is given", "add at least one, for example manifest: my_agent.yaml"
    elif twice:
        what, remedy = f"two agents are called {twice[0]!r}", "give one a manifest file of another name"
    elif long:
        what = f"the agent's name {long[0]!r} has more than 40 characters"
        remedy = "shorten the manifest's name"
    if what:
        raise SetupError("agents", what, remedy)
    return labels


@dataclass(frozen=True, slots=True)
class _BoundBase:
    """A base SimSpec, and the paths of the factors that lead somewhere in it."""

    text: str
    paths: Mapping[str, SpecPath]

    @classmethod
    def of(cls, base: SimSpec, factors: Sequence[DesignFactor]) -> tuple[_BoundBase, list[_FactorFault]]:
        """The base with its paths, and the faults of factors that do not fit it."""
        faults: list[_FactorFault] = []
        paths: dict[str, SpecPath] = {}
        for factor in factors:
            for text in _paths_of(factor):
                where = f"design: factor {factor.name!r}: path {text}"
                try:
                    paths[text] = find_path(base, text)
                except SetupError as error:
                    faults += [(factor, replace(fault, where=where)) for fault in error.faults]
                    continue
                if text in factor.sets and (other := _other_unit(where, factor, paths[text])):
                    faults.append((factor, other))
            faults += [(factor, fault) for fault in _two_units(factor, paths)]
        faults += [(None, fault) for fault in _set_twice(factors, paths)]
        return cls(base.model_dump_json(), paths), faults


_FactorFault = tuple[DesignFactor | None, Fault]


@dataclass(frozen=True, slots=True)
class _Patches:
    """The factors of a design, bound to the base SimSpecs that they change.

    `chooser` is the factor whose levels are the names of `bases`; None for a single base, which is named "".
    """

    design: Design
    bases: Mapping[str, _BoundBase]
    chooser: DesignFactor | None

    @classmethod
    def of(cls, base: Bases, design: Design) -> _Patches:
        chooser = _chooser(base, design)
        factors = [factor for factor in design.factors if factor is not chooser]
        bases: dict[str, _BoundBase] = {}
        faults: dict[Fault, DesignFactor | None] = {}
        for name, simspec in {"": base}.items() if isinstance(base, SimSpec) else base.items():
            bases[name], of_base = _BoundBase.of(simspec, factors)
            where = f"situation {name!r}: " if name else ""
            faults |= {replace(fault, where=f"{where}{fault.where}"): factor for factor, fault in of_base}
        # A conditional factor may belong to some situations only; `_with` refuses it elsewhere.
        final = [
            fault
            for fault, factor in faults.items()
            if factor is None
            or factor.when is None
            or not any(base.paths.keys() >= set(_paths_of(factor)) for base in bases.values())
        ]
        if final:
            raise SetupError(final)
        return cls(design, bases, chooser)

    def apply(self, point: DesignPoint) -> SimSpec:
        """The base with all levels of a point. Raises SetupError naming the factors at fault."""
        try:
            return self._with(point.levels, self._base(point))
        except SetupError as error:
            # Factors are tried alone first: a fault of one reads better than a fault of the point.
            raise SetupError(self._alone(point) or self._together(point, error)) from None

    def rated(self, rate: Rating | None) -> Difficulties | None:
        """As `rate`, for levels."""
        if rate is None:
            return None
        return lambda levels: rate(self.apply(DesignPoint("candidate", levels)))

    def _base(self, point: DesignPoint) -> _BoundBase:
        return self.bases["" if self.chooser is None else str(point.levels[self.chooser.name])]

    def _with(self, levels: Mapping[str, FactorLevel], base: _BoundBase) -> SimSpec:
        document: Any = json.loads(base.text)
        for factor in self.design.factors:
            if factor.name in levels and factor is not self.chooser:
                for path, value in factor.changes(levels[factor.name]).items():
                    if path not in base.paths:
                        remedy = f"narrow the `when` of factor {factor.name!r} to the situations that have it"
                        raise SetupError(path, "does not exist in this situation", remedy)
                    base.paths[path].set(document, value)
        return validate_document(document, SimSpec)

    def _alone(self, point: DesignPoint) -> list[Fault]:
        """Faults of factors that are invalid on their own."""
        faults: list[Fault] = []
        for factor in self.design.factors:
            level = point.levels[factor.name]
            try:
                self._with({factor.name: level}, self._base(point))
            except SetupError as error:
                where = (
                    f"design: factor {factor.name!r}: level {level!r} for {', '.join(factor.changes(level))}"
                )
                faults += [
                    Fault(where, f"{fault.where}: {fault.what}", fault.remedy) for fault in error.faults
                ]
        return faults

    def _together(self, point: DesignPoint, error: SetupError) -> list[Fault]:
        levels = ", ".join(f"{name}={level}" for name, level in point.levels.items())
        where, remedy = f"design point {point.id} ({levels})", "change one of these levels"
        return [
            Fault(where, f"{fault.where}: {fault.what}", fault.remedy or remedy) for fault in error.faults
        ]


def _paths_of(factor: DesignFactor) -> list[str]:
    """Every path that a factor can change, each once."""
    return list(dict.fromkeys([*factor.sets, *(path for patch in factor.patches.values() for path in patch)]))


def _chooser(base: Bases, design: Design) -> DesignFactor | None:
    """The factor whose levels choose the base. Raises SetupError if it does not name exactly the bases."""
    choosers = [factor for factor in design.factors if factor.chooses_base]
    if isinstance(base, SimSpec):
        # With one base, the path `base` is refused like any other that does not exist.
        return None
    if len(choosers) != 1:
        what = f"{len(choosers)} factors set {BASE}, and the design has {len(base)} situations"
        raise SetupError("design", what, f"let one factor set {BASE}")
    (chooser,) = choosers
    if set(chooser.levels) != set(base):
        raise SetupError(
            f"design: factor {chooser.name!r}",
            f"its levels {list(chooser.levels)} are not the situations",
            f"give the levels {list(base)}",
        )
    return chooser


def _other_unit(where: str, factor: DesignFactor, path: SpecPath) -> Fault | None:
    """The fault of a factor whose unit is not its field's.

    A field without a unit accepts no unit that other fields have.
    """
    if factor.unit is None or path.unit == factor.unit or path.open:
        return None
    what = f"the factor's unit is {factor.unit!r}"
    if path.unit is not None:
        return Fault(where, f"{what}, the field's unit is {path.unit!r}", f"give {path.unit}")
    if factor.unit in UNITS.values():
        remedy = 'leave the unit out or write unit: "1", or name another field'
        return Fault(where, f"{what}, but the field has none", remedy)
    return None


def _two_units(factor: DesignFactor, paths: Mapping[str, SpecPath]) -> list[Fault]:
    """The fault of a factor that sets fields of different units with one number."""
    stated = {paths[text].unit: text for text in factor.sets if text in paths and paths[text].unit}
    if factor.unit is not None or len(stated) < 2:
        return []
    fields = ", ".join(f"{text} ({unit})" for unit, text in stated.items())
    what = f"sets fields of different units: {fields}"
    remedy = "keep the fields of one unit here, and set the others by a second factor with a formula"
    return [Fault(f"design: factor {factor.name!r}", what, remedy)]


def _set_twice(factors: Sequence[DesignFactor], paths: Mapping[str, SpecPath]) -> list[Fault]:
    """Faults of fields that two factors set, also as part of a larger value: one would undo the other."""
    users: dict[tuple[str | int, ...], dict[str, str]] = {}
    for factor in factors:
        for text in _paths_of(factor):
            if text in paths:
                users.setdefault(paths[text].steps, {})[factor.name] = text
    for steps, names in users.items():
        for length in range(1, len(steps)):
            names.update(users.get(steps[:length], {}))
    return [
        Fault(
            f"design: path {next(iter(names.values()))}",
            f"is set by the factors {', '.join(names)}",
            "let one factor set it",
        )
        for names in users.values()
        if len(names) > 1
    ]
