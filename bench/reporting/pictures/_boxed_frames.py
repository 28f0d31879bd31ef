"""Frames of recorded runs with true and detected boxes, side by side as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.contracts import Pixels, Tape, detections_by_frame
from bench.errors import SetupError
from bench.recording import read_simspec, read_tape
from bench.simspec import SimSpec

from ._verdicts import ERRORS, JudgedBox, JudgedFrame, Verdict, judge, worst_frame

# Blue, green, red; as in the report.
COLOURS = {
    Verdict.TRUTH: (255, 255, 255),
    Verdict.UNCLEAR: (160, 160, 160),
    Verdict.HIT: (94, 204, 46),
    Verdict.MISSED: (59, 59, 255),
    Verdict.MISLABELLED: (255, 91, 225),
    Verdict.FALSE: (0, 176, 255),
}
CAPTION_PX, GAP_PX = 26, 6
COLUMNS = 3
FONT = 0  # cv2.FONT_HERSHEY_SIMPLEX
PAPER = 255


def boxed_frames(recordings: Sequence[Path], times_s: Sequence[float] = ()) -> Pixels:
    """One picture: a row for each recording of the frames at these times, or of the frame with the most errors; single frames
    stand side by side.

    Frames are as recorded, or drawn again from the recorded states. Raises SetupError where there is no such frame, or what
    draws it is not installed.
    """
    rows = []
    for recording in recordings:
        simspec = read_simspec(recording)
        tape = read_tape(recording, simspec)
        given = " with a result of the detector" if simspec.perception.by_bench else ""
        frames = [(f"{given} up to {time_s:g} s", _at(simspec, tape, time_s)) for time_s in times_s] or [
            (" in which the detector of the bench erred", worst_frame(simspec, tape))
        ]
        rows.append([_drawn(recording, simspec, frame, which) for which, frame in frames])
    if max(map(len, rows)) == 1:
        singles = [picture for row in rows for picture in row]
        rows = [singles[first : first + COLUMNS] for first in range(0, len(singles), COLUMNS)]
    return _laid_out(rows)


def _at(simspec: SimSpec, tape: Tape, time_s: float) -> JudgedFrame | None:
    """The last frame of the main camera up to a time; of those with a result where the bench makes detections."""
    name, given = simspec.vehicle.camera.name, simspec.perception.by_bench
    answers = detections_by_frame(tape, name)
    frames = [
        frame
        for frame in tape.frames
        if frame.camera == name
        and frame.exposed.s <= time_s
        and (not given or (name, frame.exposed.ns) in answers)
    ]
    if not frames:
        return None
    answer = answers.get((name, frames[-1].exposed.ns))
    judged = judge(tape.cast, frames[-1], answer.detections if answer else ())
    if given:
        return judged
    # The agent looks for itself, so nothing says what it missed.
    boxes = tuple(JudgedBox(item.box, Verdict.TRUTH, item.text) for item in judged.boxes)
    return JudgedFrame(judged.camera, judged.number, judged.exposed, boxes)


def _drawn(recording: Path, simspec: SimSpec, frame: JudgedFrame | None, which: str) -> Pixels:
    # Imported here: other commands start without OpenCV.
    import cv2

    from ._frame_pixels import frame_pixels

    where = str(recording)
    if frame is None:
        raise SetupError(where, f"has no frame{which}", "give another time with --at")
    (camera,) = (camera for camera in simspec.vehicle.cameras if camera.name == frame.camera)
    pixels = frame_pixels(recording, simspec, camera, frame.number, frame.exposed)
    if pixels is None:
        raise SetupError(
            where, f"does not tell what frame {frame.number} showed", "give another time with --at"
        )
    picture = pixels.bgr.copy()
    for item in frame.boxes:
        left, top, right, bottom = (round(value) for value in item.box)
        colour, width = COLOURS[item.verdict], 1 + (item.verdict in ERRORS)
        cv2.rectangle(picture, (left, top), (right, bottom), colour, width)
        if item.verdict in ERRORS | {Verdict.HIT}:
            (width_px, height_px), below_px = cv2.getTextSize(item.text, FONT, 0.4, 1)
            # A label whose box leaves the frame stays inside.
            x = max(0, min(left, picture.shape[1] - width_px))
            lowest = picture.shape[0] - below_px
            y = top - below_px if top > 2 * height_px else min(lowest, bottom + height_px + below_px)
            # Grass is as green as a hit: words stand on black.
            corner = (x + width_px, y + below_px)
            cv2.rectangle(picture, (x, y - height_px - 2), corner, (0, 0, 0), cv2.FILLED)
            cv2.putText(picture, item.text, (x, y), FONT, 0.4, colour, 1, cv2.LINE_AA)
    # A detected actor has two boxes, of which the detection's counts.
    counts = ", ".join(
        f"{count} {verdict}"
        for verdict, count in sorted(frame.counts.items())
        if verdict is not Verdict.TRUTH
    )
    caption = np.full((CAPTION_PX, picture.shape[1], 3), PAPER, dtype=np.uint8)
    words = f"{simspec.name}, {frame.exposed.s:.1f} s: {counts or f'{len(frame.boxes)} in view'}"
    cv2.putText(caption, words, (4, 18), FONT, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
    return np.vstack([caption, picture])


def _laid_out(rows: Sequence[Sequence[Pixels]]) -> Pixels:
    height_px, width_px = (max(picture.shape[axis] for row in rows for picture in row) for axis in (0, 1))
    columns = max(map(len, rows))
    sheet = np.full(
        (len(rows) * (height_px + GAP_PX) - GAP_PX, columns * (width_px + GAP_PX) - GAP_PX, 3),
        PAPER,
        dtype=np.uint8,
    )
    for place, row in enumerate(rows):
        for column, picture in enumerate(row):
            top, left = place * (height_px + GAP_PX), column * (width_px + GAP_PX)
            sheet[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return sheet
