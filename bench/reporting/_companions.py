"""What stands beside the report for other programs: scores.csv, runs.csv, card.md and junit.xml."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from bench.visible_text import visible

from ._campaign_data import ALL_CONFIGURATIONS, ReportData, Tally
from .statistics._measured import MeasuredCompetence, measured_competence
from .text._sheet import Sheet, sheets

COMPANIONS = ("scores.csv", "runs.csv", "card.md", "junit.xml")
# The numbers of a node, as scores.csv has them and `rebar check` asks for them; those of a principle are of its verdicts.
_COUNTS = ("flown", "runs", "passed")
_SHARES = (
    *("passed.share", "passed.low", "passed.high"),
    *("competence_90", "competence_90.low", "competence_50", "competence_50.low"),
    *("measured_90", "measured_90.low", "measured_50", "measured_50.low"),
)
# Fields of a tally, with `_` in place of the dot.
_FIELDS = ("score", "confidence", "confidence.low", "confidence.high", "difficulty.low", "difficulty.high")
_NUMBERS: dict[str, type[pl.DataType]] = dict.fromkeys(_COUNTS, pl.Int64) | dict.fromkeys(
    (*_SHARES, *_FIELDS, "floor"), pl.Float64
)
_NAMES: dict[str, type[pl.DataType]] = dict.fromkeys(
    ("agent", "configuration", "node", "title", "level"), pl.String
)


def companions(data: ReportData, runs: pl.DataFrame, measured: MeasuredCompetence) -> dict[str, str]:
    """The texts of the files COMPANIONS, by name; `runs` is the table of `runs_table`."""
    cards = ("\n".join(map(visible, _card_lines(sheet, data.name))) + "\n" for sheet in sheets(data))
    texts = (csv_text(scores_table(data, measured)), csv_text(runs), "\n".join(cards), _junit(data, runs))
    return dict(zip(COMPANIONS, texts, strict=True))


def csv_text(table: pl.DataFrame) -> str:
    """The table as CSV. A text that a spreadsheet would take for a formula gets an apostrophe before it: some are an agent's."""
    texts = pl.col(pl.String)
    return table.with_columns(
        pl.when(texts.str.contains(r"^[=+@\t\r-]") & ~texts.str.contains(r"^-[0-9.]+$"))
        .then("'" + texts)
        .otherwise(texts)
        .name.keep()
    ).write_csv()


def scores_table(data: ReportData, measured: MeasuredCompetence | None = None) -> pl.DataFrame:
    """A row for each agent, node and difficulty configuration, and one over all of them (`all`).

    `runs` are those that considered the node, of `flown`. `passed.share` is that of `passed` in `runs`, with its 95 %
    interval. `measured_90` is the competence on the measured scale, where the node has one. `floor` is the best confidence of
    an agent without merit.
    """
    measured = measured or measured_competence(data)
    labels = {configuration.key: configuration.label for configuration in data.configurations}
    rows = [
        {
            "agent": tally.agent,
            "configuration": labels.get(tally.configuration, tally.configuration),
            "node": tally.node,
            "title": data.title(tally.node),
            "level": tally.level,
        }
        | _numbers(data, tally, measured)
        for tally in data.tallies.values()
    ]
    return pl.DataFrame(rows, schema=_NAMES | _NUMBERS)


def requirements_table(data: ReportData) -> pl.DataFrame:
    """A row for each agent, over all its runs: `agent`, and for each node its numbers, such as `KA-18.passed.low`."""
    measured = measured_competence(data)
    rows = [
        {"agent": agent}
        | {
            f"{node}.{name}": value
            for node in data.nodes
            if (tally := data.tally(agent, node))
            for name, value in _numbers(data, tally, measured).items()
        }
        for agent in data.agents
    ]
    schema: dict[str, type[pl.DataType]] = {"agent": pl.String}
    schema |= {f"{node}.{name}": kind for node in data.nodes for name, kind in _NUMBERS.items()}
    return pl.DataFrame(rows, schema=schema)


def _numbers(data: ReportData, tally: Tally, measured: MeasuredCompetence) -> dict[str, Any]:
    """Those that there are."""
    passes, floor = tally.passes, data.floors.get(tally.node)
    numbers: dict[str, Any] = {"flown": tally.runs, "runs": passes.runs, "passed": passes.passed}
    numbers |= {name: getattr(tally, name.replace(".", "_")) for name in _FIELDS}
    if passes.runs:
        share = passes.passed / passes.runs
        numbers |= {"passed.share": share, "passed.low": passes.low, "passed.high": passes.high}
    on_scale = measured.tallies.get((tally.agent, tally.configuration, tally.node))
    for scale, source in (("competence", tally), ("measured", on_scale)):
        for rate, competence in source.competence.items() if source else ():
            numbers |= {f"{scale}_{rate}": competence.value, f"{scale}_{rate}.low": competence.low}
    if floor is not None and tally.configuration == ALL_CONFIGURATIONS:
        numbers["floor"] = floor.floor
    return numbers


def _card_lines(sheet: Sheet, campaign: str) -> Iterator[str]:
    """The page to sign as Markdown, for a repository or a model card."""
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
