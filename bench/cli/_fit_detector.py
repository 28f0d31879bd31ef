"""`rebar fit-detector`: the error model that behaves as the detections of some recordings did."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.perception.fit import DetectorFit


def fit_detector(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings of sessions with detections (.mcap)")],
    out: Annotated[
        Path | None, typer.Option(help="Write the fitted model and its counts to this YAML file")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Fit the error model of the simulated detector to recorded detections, with the counts behind each number.

    The part `perception` of the result can be copied into a SimSpec, which then detects as these recordings did.

    Example: rebar fit-detector out/pixels/runs/*/recording.mcap --out fitted.yaml
    """
    from bench.documents import dump_yaml
    from bench.perception.fit import fit_detector as fit_model
    from bench.recording import check_whole, read_simspec, read_tape

    for path in recordings:
        check_whole(path)
    simspecs = [read_simspec(path) for path in recordings]
    fit = fit_model(
        [(simspec, read_tape(path, simspec)) for path, simspec in zip(recordings, simspecs, strict=True)]
    )
    if out is not None:
        out.write_text(dump_yaml(fit), encoding="utf-8")
    if as_json:
        print(fit.model_dump_json(indent=1, ensure_ascii=True))
        return
    table = plain_table(("parameter", "value", "from"), texts=("from",))
    for row in _rows(fit):
        add_plain_row(table, row)
    plain_console().print(table)
    print_lines(plain_console(), _closing(fit, out))


def _rows(fit: DetectorFit) -> Iterator[tuple[str, str, str]]:
    """Each number with the counts behind it."""
    model, counts = fit.perception.model, fit.evidence
    continued, followed = counts.false_continued
    detected = f"{counts.detected} of {counts.sightings} sightings"
    wrong = sum(
        count for true, row in counts.labels.items() for label, count in row.labels.items() if label != true
    )
    labelled = sum(row.detections for row in counts.labels.values())
    sources = {
        "half_height_px": detected,
        "slope": detected,
        "ceiling": detected,
        "correlation_s": f"{counts.both_detected} of {counts.frame_pairs} pairs detected twice",
        "mislabel": f"{wrong} of {labelled} labels wrong",
        "jitter_px": f"{counts.boxes} boxes",
        "jitter_share": f"{counts.boxes} boxes",
        "drift_px": f"{counts.boxes} boxes",
        "drift_s": f"{counts.box_pairs} pairs of boxes",
        "false_per_frame": f"{counts.false_detections} in {counts.frames} frames",
        "false_persistence_s": f"{continued} of {followed} in the next frame again",
        "latency_s": f"{counts.delays} frames",
        "latency_jitter_s": f"{counts.delays} frames",
        "id_switches_per_s": f"{counts.switches} in {counts.track_s:g} s of tracks",
    }
    for name, source in sources.items():
        yield (
            name,
            f"{getattr(model, name):g}",
            "kept: too little seen" if name in counts.unfitted else source,
        )


def _closing(fit: DetectorFit, out: Path | None) -> Iterator[str]:
    from bench.perception.fit import CARRIED_PARAMETERS

    model = fit.perception.model
    if model.size_curve:
        yield "no curve of the stated form fits: size_curve takes the place of half_height_px, slope and ceiling"
        points = ", ".join(f"{point.px:.3g} px {point.detected:.3g}" for point in model.size_curve)
        yield f"size_curve (effective size and probability of detection): {points}"
        yield f"class_factors: {', '.join(f'{label} {factor:g}' for label, factor in model.class_factors.items())}"
    if model.false_labels:
        shares = ", ".join(f"{label} {share:g}" for label, share in model.false_labels.items())
        yield f"false_labels: {shares}; false_score {model.false_score:g}"
    for kind, quantiles in model.scores.model_dump().items():
        if quantiles:
            middle = quantiles[len(quantiles) // 2]
            yield f"scores.{kind}: {quantiles[0]:.2f} to {quantiles[-1]:.2f}, half of them above {middle:.2f}"
    for true, row in model.confusion.items():
        text = ", ".join(f"{label} {share:g}" for label, share in row.items()) or "never wrong"
        yield f"confusion of {true}: {text} (from {fit.evidence.labels[true].detections} detections)"
    yield f"as in the recordings' SimSpecs: {', '.join(CARRIED_PARAMETERS)}"
    if fit.evidence.unknown_labels:
        yield f"labels outside the catalogue: {fit.evidence.unknown_labels} detections, in no confusion"
    if out is not None:
        yield f"written to {out}: copy its perception: into a SimSpec"
