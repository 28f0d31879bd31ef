"""What a fit says: the model, and the counts behind each of its numbers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bench.documents import Document
from bench.simspec import Perception


class SizeBand(Document):
    """Sightings of one range of effective sizes: how many were detected, and how many the model expects."""

    from_px: float
    until_px: float
    sightings: int
    detected: int
    expected: float = Field(description="By the fitted model.")


class LabelCounts(Document):
    """Detections of one class by the label that they bore."""

    detections: int
    labels: dict[str, int]


class FitEvidence(Document):
    """The counts behind the numbers of a fitted model."""

    recordings: int
    frames: int = Field(description="Frames with a result, outside outages of the detector.")
    unanswered: int = Field(description="Frames without a result, which count nowhere.")
    sightings: int = Field(description="Actors in these frames, by the truth.")
    detected: int = Field(description="Those of them that a detection was matched with.")
    false_detections: int = Field(description="Detections that no actor was matched with.")
    false_continued: tuple[int, int] = Field(
        description="False detections that stayed in the next frame, of those that had a next frame."
    )
    bands: tuple[SizeBand, ...] = Field(description="half_height_px, slope, ceiling: the curve over size.")
    frame_pairs: int = Field(description="correlation_s: actors in sight in two successive frames.")
    both_detected: int = Field(description="correlation_s: of these pairs, detected in both.")
    labels: dict[str, LabelCounts] = Field(description="mislabel and confusion, by true label.")
    unknown_labels: int = Field(
        description="Detections with a label that the catalogue does not have; in no confusion."
    )
    boxes: int = Field(description="jitter_px, drift_px: boxes compared, away from the border.")
    box_pairs: int = Field(description="drift_s: boxes of one actor in successive detections.")
    track_pairs: int = Field(description="id_switches_per_s: successive detections of one actor with tracks.")
    track_s: float = Field(description="The time between them, summed.")
    switches: int = Field(description="The changes of track among them.")
    unfitted: tuple[str, ...] = Field(
        description="Parameters that these recordings cannot show: as in their SimSpecs, or at their defaults."
    )


class DetectorFit(Document):
    """An error model that behaves as the detections of some recordings did; `perception` is a part of a SimSpec."""

    format: Literal["rebar.detector-fit/1"] = "rebar.detector-fit/1"
    perception: Perception
    evidence: FitEvidence
