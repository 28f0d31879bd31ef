"""`rebar calibrate`: checks difficulty against the outcomes of several agents, and fits measured difficulty."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from bench.errors import Fault, SetupError

from ._missing_runs import exit_if_incomplete, print_missing_in
from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from bench.difficulty import DifficultyScale
    from bench.reporting import Calibration
    from bench.statistics import AgentAbility, DifficultySlope, ScaleProof

MAX_ODDS_RATIO = 1000.0
SEPARATED = "* separated: Firth's penalised likelihood, a design point counts as one run"


def calibrate(
    campaigns: Annotated[
        list[Path] | None, typer.Argument(help="Folders of campaigns over one decomposition, to test")
    ] = None,
    fit: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of a panel's campaign: fit a scale to it. Repeatable"),
    ] = None,
    scale: Annotated[
        Path | None, typer.Option(help="File of a scale. Default: the fitted one, else the shipped one")
    ] = None,
    agent: Annotated[
        list[str] | None,
        typer.Option(help="Test only these agents. Default: all but null agents and the oracle"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write the fitted scale to, with what the tests show; it must not exist yet"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of resampling")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Check difficulty against outcomes: does failure rise with the published rating, and with measured difficulty?

    With --fit, fit the scale of measured difficulty first. Needs two agents or more. Ends with code 3 if a
    campaign lacks runs.

    Example: rebar calibrate out/demo out/mine

    Example: rebar calibrate out/held-out --fit out/panel --out scale.yaml
    """
    from bench.documents import dump_yaml
    from bench.reporting import calibrate as calibrate_campaigns
    from bench.reporting import fit_difficulty

    folders, panel, agents = campaigns or [], fit or [], agent or []
    _require_valid(folders, panel, agents, scale, out)
    fitted = fit_difficulty(panel) if panel else None
    chosen = fitted if scale is None else _load(scale, folders[0])
    calibration = calibrate_campaigns(folders, agents, scale=chosen, seed=seed) if folders else None
    result = calibration.scale if calibration else fitted
    if out is not None and result is not None:
        out.write_text(dump_yaml(result), encoding="utf-8")
    completeness = print_missing_in([*folders, *panel], as_json=as_json)
    if as_json:
        document = {
            "scale": result and result.model_dump(mode="json"),
            **(_document(calibration) if calibration else {}),
            "completeness": [report and report.model_dump(mode="json") for report in completeness],
        }
        # NaN is not JSON: other readers would refuse the document.
        print(json.dumps(document, indent=1, allow_nan=False))
    else:
        _show(fitted, calibration, out)
    exit_if_incomplete(completeness)


def _require_valid(
    folders: list[Path], panel: list[Path], agents: list[str], scale: Path | None, out: Path | None
) -> None:
    faults = []
    if not folders and not panel:
        faults.append(
            Fault("calibrate", "has nothing to test and nothing to fit", "name a folder, or --fit DIR")
        )
    if scale is not None and (panel or not folders):
        faults.append(Fault("--scale", "is for testing folders, without --fit", "leave one of them out"))
    if agents and not folders:
        faults.append(Fault("--agent", "is for testing folders", "name a folder, or leave it out"))
    if out is not None and not panel:
        faults.append(Fault("--out", "writes the scale that --fit fits", "add --fit DIR"))
    if out is not None and not out.parent.is_dir():
        faults.append(Fault(str(out.parent), "is no folder", "make it, or write elsewhere"))
    if out is not None and os.path.lexists(out):
        faults.append(Fault(str(out), "already exists and is not overwritten", "name another file"))
    if faults:
        raise SetupError(faults)


def _load(scale: Path, folder: Path) -> DifficultyScale:
    from bench.difficulty import load_scale
    from bench.reporting import load_report_data

    document = load_report_data(folder).document
    if document is None:
        raise SetupError(folder, "has no readable decomposition", "`rebar score` it over one")
    return load_scale(scale, document)


def _document(calibration: Calibration) -> dict[str, Any]:
    return {
        "campaigns": [str(folder) for folder in calibration.folders],
        "decomposition": calibration.decomposition.name,
        "decomposition_sha256": calibration.decomposition.digest,
        "agents": calibration.agents,
        "excluded_agents": calibration.excluded,
        "runs": calibration.runs,
        "design_points": calibration.design_points,
        "notes": calibration.notes,
        "dependence": calibration.dependence,
        "overall": _slope_document(calibration.overall),
        "nodes": [
            {
                "node": node.node,
                "title": node.title,
                "rated": _proof_document(node.rated),
                "measured": node.measured and _proof_document(node.measured),
            }
            for node in calibration.nodes
        ],
    }


def _proof_document(proof: ScaleProof) -> dict[str, Any]:
    return {**asdict(proof), "slope": _slope_document(proof.slope), "reason": proof.reason}


def _slope_document(slope: DifficultySlope) -> dict[str, Any]:
    return {**asdict(slope), "direction": slope.direction}


def _fit_lines(scale: DifficultyScale) -> list[str]:
    flown = scale.fitted_to[0]
    lines = [
        f"fitted to {flown.name}: {flown.runs} runs of {len(flown.agents)} agents in {flown.scenes} scenes; "
        f"{len(scale.nodes)} nodes have a model, over {len(scale.features)} features"
    ]
    for name, node in scale.nodes.items():
        largest = sorted(node.weights.items(), key=lambda item: -abs(item[1]))[:3]
        lines.append(
            f"{name}: {node.failures} of {node.trials} failed; "
            + (
                ", ".join(f"{feature} {weight:+.2f}" for feature, weight in largest)
                or "no feature has a weight"
            )
        )
    return lines


def _show(fitted: DifficultyScale | None, calibration: Calibration | None, out: Path | None) -> None:
    if fitted is not None:
        print_lines(*_fit_lines(fitted))
    if calibration is not None:
        _show_tests(calibration)
    if out is not None:
        print(f"{out}: written")


def _show_tests(calibration: Calibration) -> None:
    console = plain_console()
    print_lines(*_heading(calibration))
    shown = [node for node in calibration.nodes if node.rated.trials]
    slopes = [calibration.overall, *(node.rated.slope for node in shown)]
    print_lines("Published rating: AUC, and odds of failure for each 10 points")
    console.print(_table([(node.node, node.rated) for node in shown], gaps=False))
    measured = [(node.node, node.measured) for node in shown if node.measured]
    if measured:
        print_lines(
            "Measured difficulty; gap: the largest between predicted and observed failure in five bins"
        )
        console.print(_table(measured, gaps=True))
        slopes += [proof.slope for _, proof in measured]
        print_lines(*([calibration.dependence] if calibration.dependence else _verdict(measured)))
    else:
        print_lines("No scale of measured difficulty for this decomposition: see --fit")
    if any(slope.state == "separated" for slope in slopes):
        print_lines(SEPARATED)


def _verdict(measured: list[tuple[str, ScaleProof]]) -> list[str]:
    from itertools import groupby

    holding = [node for node, proof in measured if not proof.reason]
    lines = [f"The scale holds for {len(holding)} of {len(measured)} nodes: {', '.join(holding) or 'none'}"]
    refused = sorted((proof.reason, node) for node, proof in measured if proof.reason)
    for reason, rows in groupby(refused, key=lambda row: row[0]):
        lines.append(f"no scale, {reason}: {', '.join(node for _, node in rows)}")
    return lines


def _heading(calibration: Calibration) -> list[str]:
    lines = [
        f"{calibration.decomposition.name}: {calibration.runs} runs of {len(calibration.agents)} agents at "
        f"{calibration.design_points} design points",
        *(_ability(ability) for ability in calibration.overall.agents),
        f"all observables: odds of failure x {' (95 % '.join(_slope_cells(calibration.overall))}) for 10 points of published rating",
    ]
    if calibration.excluded:
        lines.append(f"left out: {', '.join(calibration.excluded)} (--agent names the agents that count)")
    return [*lines, *calibration.notes]


def _ability(ability: AgentAbility) -> str:
    return f"{ability.agent}: {ability.failed} of {ability.trials} trials of observables failed"


def _table(proofs: list[tuple[str, ScaleProof]], *, gaps: bool) -> Table:
    columns = (
        "node",
        "trials",
        "failed",
        "AUC",
        "95 %",
        "odds x",
        "95 % or why not",
        *(["gap"] if gaps else []),
    )
    table = plain_table(columns, texts=("95 % or why not",))
    for node, proof in proofs:
        ends = "-" if proof.auc_low is None else f"{proof.auc_low:.2f} to {proof.auc_high:.2f}"
        cells = (
            node,
            str(proof.trials),
            str(proof.failures),
            "-" if proof.auc is None else f"{proof.auc:.2f}",
            ends,
            *_slope_cells(proof.slope),
        )
        gap = max((part.gap for part in proof.bins), default=0.0)
        add_plain_row(table, (*cells, f"{gap:.0%}") if gaps else cells)
    return table


def _slope_cells(slope: DifficultySlope) -> tuple[str, str]:
    if slope.slope is None:
        return "-", str(slope.state)
    mark = "*" if slope.state == "separated" else ""
    return f"{_odds_ratio(slope.slope)}{mark}", f"{_odds_ratio(slope.low)} to {_odds_ratio(slope.high)}"


def _odds_ratio(log_odds: float | None) -> str:
    """An odds ratio in three digits; a bound that does not exist is a dash."""
    if log_odds is None:
        return "-"
    limit = math.log(MAX_ODDS_RATIO)
    if abs(log_odds) > limit:
        return f"> {MAX_ODDS_RATIO:g}" if log_odds > 0.0 else f"< 1/{MAX_ODDS_RATIO:g}"
    return f"{math.exp(log_odds):.3g}"
