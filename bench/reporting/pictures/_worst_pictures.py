"""The pictures of the page: in each of a few runs, the frame in which the detector failed worst."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import polars as pl

from bench.errors import SetupError
from bench.recording import read_simspec, read_tape
from bench.scoring import Standing
from bench.simspec import SimSpec

from .._campaign_data import ReportData, Run
from ..text._format import listed, plural
from ._verdicts import ERRORS, Box, JudgedBox, JudgedFrame, Verdict, overlap, worst_frame

# Chosen: at some 100 KB each, the page stays below 1 MB more.
MAX_PICTURES = 4
MAX_WIDTH_PX = 960
MAX_NAMED_OBSERVABLES = 6

PICTURE_KEY = (
    (Verdict.HIT, "detected, with the right class"),
    (Verdict.MISSED, "in clear view and missed"),
    (Verdict.MISLABELLED, "detected with a wrong class"),
    (Verdict.FALSE, "detected where there is nothing"),
    (Verdict.TRUTH, "where the actor is"),
    (Verdict.UNCLEAR, "an actor too small or too hidden to count"),
)


@dataclass(frozen=True, slots=True)
class WorstPicture:
    """One frame with its boxes, for the page. Boxes are in pixels of `width_px` x `height_px`."""

    run: Run
    frame: JudgedFrame
    width_px: int
    height_px: int
    jpeg: str  # base64
    origin: str
    failed: str  # observables about the detections that this run did not achieve
    camera: str = ""  # a further camera; empty for the main one

    @property
    def summary(self) -> str:
        """What the detector did in this frame, in words."""
        counts = self.frame.counts
        parts = [
            f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict] and verdict in _COUNTED
        ]
        return listed(parts)

    @property
    def font_px(self) -> float:
        """Size of the labels, alike on the page for every size of picture."""
        return self.width_px / 70.0

    @property
    def labels(self) -> list[tuple[JudgedBox, float, float]]:
        """What to write beside the errors, and where: above the box, or below it at the top. No label hides another."""
        labels: list[tuple[JudgedBox, float, float]] = []
        occupied: list[Box] = []
        for item in [box for box in self.frame.boxes if box.verdict in ERRORS]:
            left, top, _, bottom = item.box
            width_px = 0.62 * self.font_px * len(item.text)
            x = min(left, max(0.0, self.width_px - width_px))
            y = top - 0.3 * self.font_px if top > 1.5 * self.font_px else bottom + self.font_px
            place = (x, y - self.font_px, x + width_px, y)
            if not any(overlap(place, other) for other in occupied):
                occupied.append(place)
                labels.append((item, x, y))
        return labels


_COUNTED = (Verdict.HIT, Verdict.MISSED, Verdict.MISLABELLED, Verdict.FALSE)


def worst_pictures(data: ReportData) -> tuple[list[WorstPicture], list[str]]:
    """The pictures, of the runs in which the detector did worst, and a sentence for each that cannot be shown.

    Only of runs whose detector worked on pictures, or whose frames are recorded: with other runs, pictures are no part
    of what went wrong.
    """
    pictures: list[WorstPicture] = []
    notes: list[str] = []
    for run in _worst_runs(data):
        if len(pictures) == MAX_PICTURES:
            break
        assert run.recording is not None
        try:
            picture = _worst_picture(data, run, read_simspec(run.recording))
        # One damaged recording, or a look that is not installed here, costs its picture and not the report.
        except (SetupError, OSError) as error:
            notes.append(f"No picture of {run.realization}: {error}")
            continue
        if picture is not None:
            pictures.append(picture)
    return pictures, notes


def _worst_runs(data: ReportData) -> list[Run]:
    shown = [
        run
        for run in data.runs
        if run.recording is not None and _has_pictures(data.simspecs.get(run.realization))
    ]
    reached = dict(
        _about_detections(data)
        .filter(pl.col("considered") > 0)
        .group_by("realization")
        .agg(pl.col("x").mean())
        .iter_rows()
    )
    # Rounded, so that the last digits of a mean do not choose between equal runs.
    return sorted(shown, key=lambda run: (round(reached.get(run.realization, 2.0), 9), run.realization))


def _has_pictures(simspec: SimSpec | None) -> bool:
    if simspec is None or not simspec.perception.by_bench:
        return False
    return simspec.perception.on_pixels or simspec.vehicle.camera.record_frames


def _about_detections(data: ReportData) -> pl.DataFrame:
    return data.scores.filter(pl.col("standing") == str(Standing.CONFIGURED_SENSOR))


def _failed_observables(data: ReportData, run: Run) -> str:
    rows = _about_detections(data).filter(
        (pl.col("realization") == run.realization) & (pl.col("considered") > 0) & (pl.col("achieved") == 0)
    )
    names: Sequence[str] = sorted(set(rows["node"].to_list()))
    unnamed = len(names) - MAX_NAMED_OBSERVABLES
    return listed(names[:MAX_NAMED_OBSERVABLES]) + (f" and {plural(unnamed, 'other')}" if unnamed > 0 else "")


def _worst_picture(data: ReportData, run: Run, simspec: SimSpec) -> WorstPicture | None:
    # Imported here: a report without pictures does not pay for OpenCV.
    from bench.camera import small_jpeg

    from ._frame_pixels import frame_pixels

    assert run.recording is not None
    frame = worst_frame(simspec, read_tape(run.recording, simspec))
    if frame is None:
        return None
    (camera,) = (camera for camera in simspec.perceiving_cameras if camera.name == frame.camera)
    pixels = frame_pixels(run.recording, simspec, camera, frame.number, frame.exposed)
    if pixels is None:
        return None
    height_px, width_px = pixels.bgr.shape[:2]
    return WorstPicture(
        run,
        frame,
        width_px,
        height_px,
        base64.b64encode(small_jpeg(pixels.bgr, MAX_WIDTH_PX)).decode(),
        pixels.origin,
        _failed_observables(data, run),
        camera.name if camera is not simspec.vehicle.camera else "",
    )
