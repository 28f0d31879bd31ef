"""What is published about the shipped agents: the runs behind it, and the parts of pages that state it.

    .venv/bin/python tests/agent_adapters/shipped_agents.py [FOLDER]

flies the campaigns `standard`, `standard_2` and `full`, with null agents and the oracle, and `demo` into FOLDER (out/shipped; what is there
is not flown again), keeps what each run measured in shipped_agents/, writes the marked parts of the pages from that, and the
numbers of docs/tutorial.md from its commands. `--pages` flies nothing and writes the marked parts alone.
`test_shipped_agents.py` compares the pages with what is kept, and a sample of it with new flights.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
import sys
import tempfile
import textwrap
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import Any

from bench.campaign import (
    Campaign,
    CampaignFolder,
    load_campaign,
    load_measurable_decomposition,
    realizations,
    with_floor,
)
from bench.contracts import Observation, Outcome, SessionResult
from bench.documents import load_document
from bench.realization import RealizationPlan
from bench.scoring import NodeFloor, ScoredRun, difficulty_of, node_floors, score_table, summary_frame
from decompositions import Decomposition, Level

ROOT = Path(__file__).parents[2]
KEPT = Path(__file__).with_name("shipped_agents")
BLOCK = re.compile(r"<!-- shipped agents: (\w+) -->\n.*?<!-- end -->\n", re.DOTALL)
WITH_FLOOR = {"standard": True, "standard_2": True, "full": True, "demo": False}
OUTCOME = "outcome"
ESCORT = "OBS-205"  # staying with the convoy

RECKLESS = ("null-everywhere", "null-mark", "null-random", "null-refuse")
REFERENCES = ("reference-naive", "reference-bystander-aware")

ABOUT_PEOPLE_AND_REPORTS = {
    *("KA-03", "KA-04", "KA-05", "KA-06", "KA-08", "KA-10", "KA-11", "KA-12"),
    *("KA-18", "KA-19", "KA-22", "KA-23", "KA-25", "KA-26", "KA-29", "KA-40", "KA-41", "KA-42"),
}
"""Key attributes about reports, marks and the perception of people: here no agent of the reckless may have half."""


@dataclass(frozen=True, slots=True)
class Published:
    """A shipped campaign, flown by the shipped agents."""

    name: str

    @property
    def file(self) -> Path:
        """What each run measured: a row for a run, a column for its outcome and for each observable."""
        return KEPT / f"{self.name}.csv"

    @property
    def campaign(self) -> Campaign:
        return _campaign(self.name)

    @property
    def decomposition(self) -> Decomposition:
        return load_measurable_decomposition(self.campaign.decomposition)

    @property
    def plans(self) -> Mapping[str, RealizationPlan]:
        return _plans(self.name)

    def keep(self, folder: Path) -> None:
        """Keep what the runs in a campaign's folder measured. Raises ValueError if one did not come to an end of its own."""
        rows = []
        for run in self.plans:
            result = load_document(CampaignFolder(folder).run(run) / "result.json", SessionResult)
            if not result.outcome.counts:
                raise ValueError(f"{run}: {result.outcome}: {result.reason}")
            rows.append({"run": run, **row_of(result.outcome, result.observations)})
        self.file.parent.mkdir(exist_ok=True)
        with self.file.open("w", newline="") as file:
            writer = csv.DictWriter(
                file, ["run", OUTCOME, *self.decomposition.observables], lineterminator="\n"
            )
            writer.writeheader()
            writer.writerows(rows)

    def rows(self) -> dict[str, dict[str, str]]:
        """The kept rows by run."""
        with self.file.open(newline="") as file:
            return {row.pop("run"): row for row in csv.DictReader(file)}

    def runs(self) -> list[ScoredRun]:
        """The kept runs, as scoring takes them."""
        decomposition, rows, plans = self.decomposition, self.rows(), self.plans
        # All agents fly a scene at the same difficulty.
        rated = cache(lambda scene: difficulty_of(decomposition, scenes[scene]))
        scenes = {(plan.design_point, plan.replicate): plan.simspec for plan in plans.values()}
        return [
            ScoredRun(
                plan.id,
                plan.design_point,
                plan.replicate,
                plan.agent,
                Outcome(rows[plan.id][OUTCOME]),
                rated((plan.design_point, plan.replicate)),
                tuple(observations_of(rows[plan.id])),
            )
            for plan in plans.values()
        ]


@cache
def _campaign(name: str) -> Campaign:
    campaign = load_campaign(ROOT / "campaigns" / f"{name}.yaml")
    return with_floor(campaign) if WITH_FLOOR[name] else campaign


@cache
def _plans(name: str) -> Mapping[str, RealizationPlan]:
    return {plan.id: plan for plan in realizations(_campaign(name))}


def row_of(outcome: Outcome, observations: Iterable[Observation]) -> dict[str, str]:
    """A run as a row: its outcome, and x of each observable to six digits, empty where it was not considered."""
    measured = {item.observable: "" if item.x is None else f"{item.x:.6g}" for item in observations}
    return {OUTCOME: outcome.value, **measured}


def observations_of(row: Mapping[str, str]) -> list[Observation]:
    """The observations of a kept row."""
    return [
        Observation(observable=name, considered=bool(x), x=float(x) if x else None)
        for name, x in row.items()
        if name != OUTCOME
    ]


class Numbers:
    """The scores of a published campaign."""

    def __init__(self, published: Published) -> None:
        self.campaign, self.decomposition = published.campaign, published.decomposition
        self.runs = published.runs()
        self.tested = [run for run in self.runs if run.agent not in self.campaign.floor_labels]
        self.floor = [run for run in self.runs if run.agent in self.campaign.floor_labels]
        self.scores = score_table(self.decomposition, self.runs)
        self.agents = list(
            dict.fromkeys(run.agent for run in [*self.tested, *sorted(self.floor, key=lambda run: run.agent)])
        )
        self.situations = {
            (plan.design_point, plan.replicate): str(plan.levels.get("situation", ""))
            for plan in published.plans.values()
        }

    def summary(self, runs: Sequence[ScoredRun]) -> dict[tuple[str, str], dict[str, Any]]:
        """The summary of some runs over all configurations, by agent and node."""
        frame = summary_frame(score_table(self.decomposition, runs), self.decomposition)
        rows = frame.filter(configuration="all").iter_rows(named=True)
        return {(row["agent"], row["node"]): row for row in rows}

    def on_floor_scenes(self) -> list[ScoredRun]:
        """The runs of all agents on the scenes that the floor flew."""
        scenes = {(run.design_point, run.replicate) for run in self.floor}
        return [run for run in self.runs if (run.design_point, run.replicate) in scenes]

    def floors(self) -> Mapping[str, NodeFloor]:
        return node_floors(score_table(self.decomposition, self.floor), self.campaign.oracle_label)

    def achieved_share(self, runs: Iterable[ScoredRun]) -> float:
        """Of the observables about the agent that were considered."""
        observables = self.decomposition.observables
        measured = [
            item.x >= observables[item.observable].threshold
            for run in runs
            for item in run.observations
            if item.x is not None and observables[item.observable].subject == "agent"
        ]
        return sum(measured) / len(measured)


def listed(words: Sequence[str]) -> str:
    """A, B and C."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """A Markdown table, of which the first columns are words and the others numbers."""
    rule = ["---"] * words + ["---:"] * (len(header) - words)
    return "".join(f"| {' | '.join(row)} |\n" for row in (header, rule, *rows))


def paragraph(text: str, indent: str = "") -> str:
    """The text in lines of a page's width, those after the first indented."""
    lines = textwrap.wrap(text, 125, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines) + "\n"


def percent(share: float) -> str:
    return f"{100.0 * share:.0f}"


def agents_table(numbers: Numbers) -> str:
    """Confidences with their intervals, over all runs."""
    principles = numbers.decomposition.at_level(Level.PRINCIPLE)
    summary, rows = numbers.summary(numbers.runs), []
    for agent in numbers.agents:
        runs = [run for run in numbers.runs if run.agent == agent]
        cells = [
            f"{percent(row['confidence_mean'])} ({percent(row['confidence_low'])} to {percent(row['confidence_high'])})"
            for row in (summary[agent, node] for node in principles)
        ]
        rows.append([f"`{agent}`", str(len(runs)), *cells, f"{100.0 * numbers.achieved_share(runs):.1f}"])
    return table(["agent", "runs", *principles, "achieved of all considered, %"], rows)


def discrimination_text(numbers: Numbers) -> str:
    """How many observables about the agent discriminate, and how the sessions ended."""
    ends = Counter(run.outcome.value for run in numbers.runs)
    floors = [
        node
        for node in numbers.floors().values()
        if node.level == "observable" and not node.configured_sensor
    ]
    considered = [node for node in floors if node.floor is not None]
    flawed = [node for node in considered if node.flaw]
    always = sum(node.floor == 1.0 for node in flawed)
    others = listed([f"{node.id} in {percent(node.floor or 0.0)} %" for node in flawed if node.floor != 1.0])
    failed = sorted(node.id for node in considered if node.ceiling not in (None, 1.0))
    return paragraph(
        f"The {len(numbers.runs)} sessions ended as {listed([f'`{end}` ({count})' for end, count in ends.most_common()])}. "
        f"Of {len(considered)} observables about the agent that were considered, {len(flawed)} do not "
        f"discriminate on these scenes: on {always} of them some null agent does in every scene what is asked"
        f"{f', on {others}' if others else ''}. "
        f"The oracle achieves {f'all but {listed(failed)}' if failed else 'every one that was considered for it'}."
    )


def competence_cells(row: Mapping[str, Any]) -> tuple[str, str]:
    """C_0.9 and C_0.5 of a node, bold where they lie strictly between the easiest and the hardest difficulty."""
    cells = []
    for share in (90, 50):
        value = row[f"competence_{share}"]
        # None of what describes the simulated detector alone, nor where failures do not rise with the rated difficulty.
        if value is None or not row["failures_rise"]:
            return "–", "–"
        # Sums of floats: the easiest difficulty is met to the last digits alone.
        inside = value > row["difficulty_low"] + 1e-6 and not row[f"competence_{share}_at_least"]
        bold = "**" if inside else ""
        cells.append(f"{bold}{value:.0f}{bold}")
    return cells[0], cells[1]


def limits(numbers: Numbers) -> dict[str, dict[str, tuple[str, str]]]:
    """The competences of the agents under test, by key attribute and agent, where some is bold."""
    summary, agents = numbers.summary(numbers.tested), [agent.label for agent in numbers.campaign.agents]
    cells = {
        node: {agent: competence_cells(summary[agent, node]) for agent in agents}
        for node in numbers.decomposition.key_attributes
    }
    return {node: row for node, row in cells.items() if "**" in str(row)}


def limits_table(numbers: Numbers) -> str:
    summary, nodes = numbers.summary(numbers.tested), numbers.decomposition.nodes
    agents = [agent.label for agent in numbers.campaign.agents]
    rows = []
    for node, row in limits(numbers).items():
        ends = summary[agents[0], node]
        span = f"{ends['difficulty_low']:.0f} to {ends['difficulty_high']:.0f}"
        rows.append(
            [node, nodes[node].title, span, *(f"{row[agent][0]} ({row[agent][1]})" for agent in agents)]
        )
    names = [f"{agent.removeprefix('reference-')} C_0.9 (C_0.5)" for agent in agents]
    return table(["key attribute", "title", "difficulties", *names], rows, words=3)


def limits_text(numbers: Numbers) -> str:
    agents, found = [agent.label for agent in numbers.campaign.agents], limits(numbers)
    counts = [
        [sum("**" in row[agent][share] for row in found.values()) for agent in agents] for share in (0, 1)
    ]
    together = [node for node, row in found.items() if all("**" in row[agent][0] for agent in agents)]
    by_agent = listed([f"{count} for `{agent}`" for agent, count in zip(agents, counts[0], strict=True)])
    return paragraph(
        "- **It locates limits.** Competence is given where failures rise with the rated difficulty (ruling 17). That at a pass rate of nine tenths (C_0.9, [scoring.md](scoring.md#competence)) lies "
        f"strictly between the easiest and the hardest difficulty of so many key attributes: {by_agent}; on "
        f"{listed(together) if together else 'none'} for all of them. At a pass rate of one half (C_0.5) it does so on "
        f"{listed([str(count) for count in counts[1]])}.",
        "  ",
    )


def escort_text(numbers: Numbers) -> str:
    shares: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for run in numbers.tested:
        for item in run.observations:
            if item.observable == ESCORT and item.x is not None:
                shares[run.agent][numbers.situations[run.design_point, run.replicate]].append(item.x)
    tensions = {situation.name: situation.tension for situation in numbers.campaign.situations}
    steps = listed([str(tensions[name]) for name in sorted(next(iter(shares.values())))])
    asked = percent(numbers.decomposition.observables[ESCORT].threshold)
    each = "; ".join(
        f"`{agent}` {listed([percent(fmean(of_agent[name])) for name in sorted(of_agent)])} %"
        for agent, of_agent in shares.items()
    )
    return paragraph(
        "- **The escort is graded.** Staying with the convoy falls from the tensions 1 and 2 to the others. At the tensions "
        f"{steps}, over three scenes each, the agents are with it for so much of the time: {each}. {asked} % are asked.",
        "  ",
    )


def steps_table(numbers: Numbers) -> str:
    """Of the key attributes under study, the share that fails at each step of measured difficulty, by agent."""
    outcomes: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for row in numbers.scores.iter_rows(named=True):
        if row["node"] in numbers.campaign.study and row["confidence"] is not None:
            # search-1a to escort-5: the application, the step and a letter.
            situation = numbers.situations[row["design_point"], row["replicate"]]
            step = situation.split("-")[1][0]
            outcomes[row["agent"], step].append(row["confidence"] < 1.0)
    cells = [
        [f"`{agent.label}`", *(percent(fmean(outcomes[agent.label, step])) for step in "12345")]
        for agent in numbers.campaign.agents
    ]
    return table(["agent", *(f"step {step}" for step in "12345")], cells)


def bad_agents_table(numbers: Numbers) -> str:
    """Mean confidences on the scenes of the floor; agents with equal numbers share a row."""
    principles, runs = numbers.decomposition.at_level(Level.PRINCIPLE), numbers.on_floor_scenes()
    summary = numbers.summary(runs)
    agents_of: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for agent in numbers.agents:
        share = numbers.achieved_share(run for run in runs if run.agent == agent)
        cells = [percent(summary[agent, node]["confidence_mean"]) for node in principles]
        agents_of[*cells, f"{100.0 * share:.1f}"].append(agent.removeprefix("null-"))
    rows = sorted(agents_of.items(), key=lambda item: float(item[0][-1]))
    return table(
        ["agent", *principles, "achieved of all considered"],
        ([", ".join(agents), *cells] for cells, agents in rows),
    )


def flying_table(numbers: Numbers) -> str:
    """Key attributes on which a null agent reaches more than half of the better reference agent."""
    summary, nodes = numbers.summary(numbers.on_floor_scenes()), numbers.decomposition.nodes
    labels = numbers.campaign.floor_labels - {numbers.campaign.oracle_label}
    rows = []
    for node in numbers.decomposition.key_attributes:
        means = {agent: summary[agent, node]["confidence_mean"] for agent in numbers.agents}
        if any(mean is None for mean in means.values()):
            continue
        best = max(means[agent.label] for agent in numbers.campaign.agents)
        reached = max(means[label] for label in labels)
        if reached > 0.5 * best:
            who = [label.removeprefix("null-") for label in sorted(labels) if means[label] == reached]
            rows.append([f"{node} {nodes[node].title}", ", ".join(who), percent(reached), percent(best)])
    return table(["key attribute", "reached most by", "%", "better reference agent, %"], rows, words=2)


def reckless_text(numbers: Numbers) -> str:
    """What the reckless null agents reach where they may not have half of the better reference agent."""
    summary, parts = numbers.summary(numbers.on_floor_scenes()), []
    for node in sorted(ABOUT_PEOPLE_AND_REPORTS):
        means = {agent: summary[agent, node]["confidence_mean"] or 0.0 for agent in numbers.agents}
        reached, best = max(means[agent] for agent in RECKLESS), max(means[agent] for agent in REFERENCES)
        if reached:
            who = listed(
                [f"*{agent.removeprefix('null-')}*" for agent in RECKLESS if means[agent] == reached]
            )
            parts.append(f"{node} ({who} {percent(reached)} of {percent(best)} %)")
    return paragraph(
        "On the key attributes about reporting, marking and bystanders the reckless agents (*everywhere*, *mark*, *random*, "
        f"*refuse*) have 0 %, but for {listed(parts)} of the better reference agent. "
        "`tests/agent_adapters/test_bad_agents.py` asserts that it is never more than half."
    )


def demo_text(numbers: Numbers) -> str:
    passed = Counter(
        (row["agent"], row["node"])
        for row in numbers.scores.iter_rows(named=True)
        if row["confidence"] == 1.0
    )
    first, second = (agent.label for agent in numbers.campaign.agents)
    scenes = len(numbers.runs) // 2
    nodes = ("KA-03", "KA-05", "KA-09", "KA-20")
    alike = listed([f"{node} {passed[first, node]} and {passed[second, node]}" for node in nodes])
    return paragraph(
        f"They are alike in finding and classifying (of {scenes} scenes they pass {alike}), and differ in marking near "
        f"bystanders (KA-18 {passed[first, 'KA-18']} and {passed[second, 'KA-18']})."
    )


BLOCKS: Mapping[str, tuple[str, Callable[[Numbers], str]]] = {
    "limits": ("standard", limits_text),
    "escort": ("standard", escort_text),
    "competences": ("standard", limits_table),
    "steps": ("standard_2", steps_table),
    "standard_2": ("standard_2", agents_table),
    "standard_2_floor": ("standard_2", discrimination_text),
    "full": ("full", bad_agents_table),
    "full_floor": ("full", discrimination_text),
    "reckless": ("full", reckless_text),
    "flying": ("full", flying_table),
    "demo": ("demo", demo_text),
}
"""The marked parts of the pages, each with the campaign behind it."""
PAGES = {
    ROOT / "docs" / "standard.md": ("steps", "standard_2", "standard_2_floor"),
    ROOT / "docs" / "standard-1.md": ("limits", "escort", "competences"),
    ROOT / "docs" / "measures.md": ("full", "full_floor", "reckless", "flying"),
    ROOT / "README.md": ("demo",),
}


@cache
def numbers_of(name: str) -> Numbers:
    return Numbers(Published(name))


def written(page: str) -> str:
    """A page with its marked parts as the kept runs give them."""

    def block(match: re.Match[str]) -> str:
        campaign, text = BLOCKS[match[1]]
        return f"<!-- shipped agents: {match[1]} -->\n{text(numbers_of(campaign))}<!-- end -->\n"

    return BLOCK.sub(block, page)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "out" / "shipped")
    parser.add_argument(
        "--pages", action="store_true", help="fly nothing; write the marked parts of the pages"
    )
    given = parser.parse_args()
    if not given.pages:
        for name, with_null_agents in WITH_FLOOR.items():
            published, folder = Published(name), given.folder / name
            command = [sys.executable, "-m", "bench.cli", "run", f"campaigns/{name}.yaml"]
            command += ["--out", str(folder.resolve())]
            subprocess.run([*command, *(["--floor"] if with_null_agents else [])], cwd=ROOT, check=True)
            published.keep(folder)
        with tempfile.TemporaryDirectory() as temporary:
            tutorial_page.PATH.write_text(tutorial_page.renumbered_page(Path(temporary)))
    for page in PAGES:
        page.write_text(written(page.read_text()))


if __name__ == "__main__":
    sys.path.append(str(ROOT / "tests" / "decompositions"))
    import tutorial_page

    main()
