"""What stands beside the report for other programs: scores.csv, runs.csv, card.md and junit.xml."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from bench.visible_text import visible

from ._campaign_data import ALL_CONFIGURATIONS, ReportData, Tally
from .text._sheet import Sheet, sheets

COMPANIONS = ("scores.csv", "runs.csv", "card.md", "junit.xml")
_TALLY_COLUMNS: dict[str, type[pl.DataType]] = {
    "agent": pl.String,
    "configuration": pl.String,
    "node": pl.String,
    "title": pl.String,
    "level": pl.String,
    "flown": pl.Int64,
    "runs": pl.Int64,
    "passed": pl.Int64,
    "share": pl.Float64,
    "low": pl.Float64,
    "high": pl.Float64,
    "competence_90": pl.Float64,
    "competence_90_low": pl.Float64,
    "competence_50": pl.Float64,
    "competence_50_low": pl.Float64,
    "score": pl.Float64,
    "confidence": pl.Float64,
    "confidence_low": pl.Float64,
    "confidence_high": pl.Float64,
    "difficulty_low": pl.Float64,
    "difficulty_high": pl.Float64,
    "floor": pl.Float64,
}
# The words of `rebar check` about a node, by the column that they stand for.
_REQUIREMENT_WORDS = {
    "passed": "passed",
    "passed.share": "share",
    "passed.low": "low",
    "passed.high": "high",
    "runs": "runs",
    "competence_90": "competence_90",
    "competence_90.low": "competence_90_low",
    "competence_50": "competence_50",
    "competence_50.low": "competence_50_low",
    "score": "score",
    "confidence": "confidence",
    "confidence.low": "confidence_low",
    "confidence.high": "confidence_high",
    "floor": "floor",
}


def companions(data: ReportData, runs: pl.DataFrame) -> dict[str, str]:
    """The texts of the files COMPANIONS, by name; `runs` is the table of `runs_table`."""
    cards = (_card(sheet, data.name) for sheet in sheets(data))
    return dict(
        zip(
            COMPANIONS,
            (scores_table(data).write_csv(), runs.write_csv(), "\n".join(cards), _junit(data, runs)),
            strict=True,
        )
    )


def scores_table(data: ReportData) -> pl.DataFrame:
    """A row for each agent, node and difficulty configuration, and one over all of them (`all`).

    `runs` are those that considered the node, of `flown`; of a principle both counts are of its verdict. `share` is that of
    `passed`, from `low` to `high` (95 %). `floor` is the best share or confidence of an agent without merit.
    """
    labels = {configuration.key: configuration.label for configuration in data.configurations}
    rows = [
        _tally_row(data, tally) | {"configuration": labels.get(name, name)}
        for (_, name, _), tally in data.tallies.items()
    ]
    return pl.DataFrame(rows, schema=_TALLY_COLUMNS)


def requirements_table(data: ReportData) -> pl.DataFrame:
    """A row for each agent, over all its runs: `agent`, and for each node `NODE.passed`, `NODE.passed.low` and so on."""
    words = {
        f"{node.id}.{word}": (node.id, column)
        for node in data.nodes.values()
        for word, column in _REQUIREMENT_WORDS.items()
    }
    rows = []
    for agent in data.agents:
        tallies = {node: _tally_row(data, tally) for node in data.nodes if (tally := data.tally(agent, node))}
        rows.append(
            {"agent": agent}
            | {word: tallies.get(node, {}).get(column) for word, (node, column) in words.items()}
        )
    return pl.DataFrame(rows, schema={"agent": pl.String} | dict.fromkeys(words, pl.Float64), strict=False)


def _tally_row(data: ReportData, tally: Tally) -> dict[str, Any]:
    passes, floor = tally.passes, data.floors.get(tally.node)
    counted = passes.runs > 0
    row = {
        "agent": tally.agent,
        "node": tally.node,
        "title": data.title(tally.node),
        "level": tally.level,
        "flown": tally.runs,
        "runs": passes.runs,
        "passed": passes.passed,
        "share": passes.passed / passes.runs if counted else None,
        "low": passes.low if counted else None,
        "high": passes.high if counted else None,
        "floor": floor.floor if floor and tally.configuration == ALL_CONFIGURATIONS else None,
    }
    for rate, competence in tally.competence.items():
        row |= {f"competence_{rate}": competence.value, f"competence_{rate}_low": competence.low}
    same = ("score", "confidence", "confidence_low", "confidence_high", "difficulty_low", "difficulty_high")
    return row | {name: getattr(tally, name) for name in same}


def _card(sheet: Sheet, campaign: str) -> str:
    """The page to sign as Markdown, for a repository or a model card."""
    return "\n".join(visible(line) for line in _card_lines(sheet, campaign)) + "\n"


def _card_lines(sheet: Sheet, campaign: str) -> Iterator[str]:
    yield f"# {sheet.agent} ({sheet.version}): REBAR campaign {campaign}"
    yield ""
    yield from (f"**{warning}**\n" for warning in sheet.warnings)
    yield sheet.flown
    yield ""
    yield "| principle | runs passed | 95 % interval | nine tenths pass up to difficulty | floor |"
    yield "| --- | --- | --- | --- | --- |"
    for row in sheet.rows:
        cells = (row.title, row.passed, row.interval, row.competence, row.floor)
        yield f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
    yield "\nNever shown:\n"
    yield from (f"- {sentence}" for sentence in sheet.not_shown)
    yield f"\nConfined by: {sheet.confinement}.\n"
    yield f"Digest of the evidence (last line of evidence.jsonl): {sheet.digest or 'not on record'}"


def _junit(data: ReportData, runs: pl.DataFrame) -> str:
    """A suite for each agent, a case for each run: a failure names the principles that it did not pass."""
    principles = [
        node.id
        for node in data.nodes.values()
        if node.level == "principle" and f"{node.id}.passed" in runs.columns
    ]
    root = ElementTree.Element("testsuites", name=visible(data.name))
    for agent in data.agents:
        suite = ElementTree.SubElement(root, "testsuite", name=visible(agent))
        counts = dict.fromkeys(("tests", "failures", "errors", "skipped"), 0)
        for row in runs.filter(agent=agent).iter_rows(named=True):
            kind, message = _ending(row, principles)
            case = ElementTree.SubElement(
                suite, "testcase", classname=visible(agent), name=row["run"], time=f"{row['simulated_s']:.3f}"
            )
            counts["tests"] += 1
            if kind:
                counts[kind] += 1
                ElementTree.SubElement(
                    case, {"failures": "failure", "errors": "error"}.get(kind, kind), message=visible(message)
                )
        suite.attrib |= {name: str(count) for name, count in counts.items()}
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _ending(row: Mapping[str, Any], principles: list[str]) -> tuple[str, str]:
    """How JUnit takes a run, and why; two empty texts for one that passed."""
    why = f"{row['outcome']}: {row['reason']}"
    if row["outcome"] in ("settled", "not finished", "flown after the stop"):
        return "skipped", why
    if not row["counts"]:
        return "errors", why
    failed = [node for node in principles if row[f"{node}.passed"] is False]
    return ("failures", f"not passed: {', '.join(failed)} ({why})") if failed else ("", "")
