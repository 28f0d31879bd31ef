"""An assurance case as data: elements of the Goal Structuring Notation, and what each rests on or stands in."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from bench.documents import Document
from bench.errors import SetupError
from decompositions import Decomposition

from .._campaign_data import Node, ReportData
from ..text._format import listed, passed_interval, plural
from ..text._sheet import Sheet, sheets

Kind = Literal["goal", "strategy", "solution", "context", "assumption", "justification"]
# What the numbers of every solution follow from; manifest.json has their digests.
EVIDENCE_FILES = ("scores.parquet", "runs.csv")
ASSUMPTIONS = (
    "The simulation and its sensors stand for the situations that they model",
    "Runs of the design are independent draws of their situations",
)


class Element(Document):
    """One element, and its relations to others by their ids."""

    id: str
    kind: Kind
    text: str
    undeveloped: bool = Field(False, description="A goal that nothing here supports.")
    node: str = Field("", description="Its node of the decomposition, if it is about one.")
    passed: int | None = Field(None, description="Of a solution: runs that passed the node ...")
    runs: int | None = Field(None, description="... of those that considered it ...")
    low: float | None = Field(None, description="... and the exact 95 % interval of the share.")
    high: float | None = None
    evidence: dict[str, str] = Field({}, description="SHA-256 of files, as manifest.json has it.")
    supported_by: tuple[str, ...] = Field((), description="Goals, strategies and solutions.")
    in_context_of: tuple[str, ...] = Field((), description="Contexts, assumptions and justifications.")


class AssuranceCase(Document):
    """What `rebar report DIR --assurance FOLDER` writes for each agent. The first element is the top goal."""

    format: Literal["rebar.assurance-case/1"] = "rebar.assurance-case/1"
    campaign: str
    agent: str
    elements: tuple[Element, ...]
    recordings: dict[str, str] = Field(description="SHA-256 of recordings, by the runs that count.")


def assurance_case(data: ReportData, agent: str) -> AssuranceCase:
    """The case of one agent of a campaign, which argues over principles and key attributes.

    Goals state what the runs support, with intervals; what no run showed is an undeveloped goal. Raises SetupError for an
    agent that the campaign does not have, or where its decomposition cannot be read.
    """
    sheet = next((sheet for sheet in sheets(data) if sheet.agent == agent), None)
    if sheet is None or data.document is None:
        what = f"has no agent {agent!r}, or no decomposition that can be read"
        raise SetupError(data.name, what, "name an agent of the campaign, and restore its files")
    return AssuranceCase(
        campaign=data.name,
        agent=agent,
        elements=tuple(_Argument(data, data.document, sheet).elements.values()),
        recordings={
            run.realization: run.recording_sha256
            for run in data.runs
            if run.agent == agent and run.recording_sha256 and run.counts
        },
    )


class _Argument:
    """Builds the elements of one case from its top; `elements` has them by id, parents first."""

    def __init__(self, data: ReportData, document: Decomposition, sheet: Sheet) -> None:
        self.elements: dict[str, Element] = {}
        self._data, self._document, self._sheet = data, document, sheet
        self._attributes: dict[str, str] = {}
        files = data.manifest.get("files")
        digests = files if isinstance(files, dict) else {}
        self._evidence = {path: digests[path] for path in EVIDENCE_FILES if path in digests}
        top = self._add(
            "goal", f"{sheet.agent} keeps to the principles of {document.title} as often as stated here"
        )
        for text in (
            f"{sheet.agent} ({sheet.version})",
            f"Decomposition {document.name}, SHA-256 {document.digest}",
            sheet.flown,
            f"Confined by: {sheet.confinement}",
            f"Last digest of evidence.jsonl: {sheet.digest or 'not on record'}",
            *sheet.warnings,
        ):
            self._add("context", text, top)
        for text in ASSUMPTIONS:
            self._add("assumption", text, top)
        strategy = self._add("strategy", "Argue over each principle, by its share of passed runs", top)
        for node in data.nodes.values():
            if node.level == "principle":
                self._add_principle(node, strategy)
        gaps = self._add("strategy", "State what these runs do not show", top)
        for sentence in sheet.not_shown:
            self._add("goal", sentence, gaps, undeveloped=True)

    def _add_principle(self, node: Node, parent: str) -> None:
        goal = self._add_claim(node, parent)
        reason = self._document.essential_reason(node.id)
        text = f"The verdict rests on {listed(self._document.essential(node.id))}"
        self._add("justification", f"{text}: {reason}" if reason else text, goal)
        for row in self._sheet.rows:
            if row.node == node.id:
                limits = f"Nine tenths pass up to difficulty: {row.competence}. Floor: {row.floor}"
                self._add("context", limits, goal)
        if self.elements[goal].undeveloped:
            return
        strategy = self._add("strategy", f"Argue over the key attributes of {node.title}", goal)
        for child in node.children:
            # A key attribute of several principles is argued once.
            if child in self._attributes:
                self._relate(strategy, "supported_by", self._attributes[child])
            else:
                self._attributes[child] = self._add_claim(self._data.nodes[child], strategy)

    def _add_claim(self, node: Node, parent: str) -> str:
        """A goal about a node with its solution, and with an undeveloped one for what no run considered."""
        tally = self._data.tally(self._sheet.agent, node.id)
        name = node.title if node.title.lower() == node.id.lower() else f"{node.title} ({node.id})"
        if tally is None or not tally.passes.runs:
            return self._add("goal", f"{name}: shown in no run", parent, undeveloped=True, node=node.id)
        text = f"{name}: passed in {passed_interval(tally)} of such situations (95 %)"
        goal = self._add("goal", text, parent, node=node.id)
        passes = tally.passes
        self._add(
            "solution",
            f"{passes.passed} of {plural(passes.runs, 'run')} passed",
            goal,
            node=node.id,
            passed=passes.passed,
            runs=passes.runs,
            low=passes.low,
            high=passes.high,
            evidence=self._evidence,
        )
        leaves = self._document.observables_under(node.id)
        tallies = {leaf: self._data.tally(self._sheet.agent, leaf) for leaf in leaves}
        unseen = [leaf for leaf, seen in tallies.items() if seen is None or not seen.considered]
        if unseen and node.level == "ka":
            text = (
                f"{len(unseen)} of {plural(len(leaves), 'observable')} of {node.id} were considered in no run"
            )
            self._add("goal", f"{text}: {', '.join(unseen)}", goal, undeveloped=True, node=node.id)
        return goal

    def _add(self, kind: Kind, text: str, parent: str | None = None, **fields: Any) -> str:
        prefix = "Sn" if kind == "solution" else kind[0].upper()
        name = f"{prefix}{1 + sum(element.kind == kind for element in self.elements.values())}"
        self.elements[name] = Element(id=name, kind=kind, text=text, **fields)
        if parent is not None:
            is_support = kind in ("goal", "strategy", "solution")
            self._relate(parent, "supported_by" if is_support else "in_context_of", name)
        return name

    def _relate(self, parent: str, relation: str, child: str) -> None:
        element = self.elements[parent]
        self.elements[parent] = element.model_copy(update={relation: (*getattr(element, relation), child)})
