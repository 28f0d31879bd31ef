"""How the agent's detections are made: whose perception it is, and the error model of the simulated one."""

from __future__ import annotations

import itertools
import math
from typing import Literal, Self

from pydantic import Field, JsonValue, model_validator

from bench.documents import Document, added_field

from ._quantities import Fraction, NotNegative, Positive, RosName
from ._weather import Environment

DUST_EXTINCTION_PER_M = 0.00024
"""Assumed: a meteorological range of 200 m at level 9."""

LEAST_CONTRAST_DEPTH = -math.log(0.02)
"""Optical depth at which 2 % of the contrast is left: Koschmieder (1924), as in docs/detection.md."""

FALSE_SCORE_MEAN = 2.0 / 7.0


class SizePoint(Document):
    """What a detector does with objects of one effective size."""

    px: Positive = Field(description="Apparent height times contrast times visible share.")
    detected: Fraction = Field(description="Probability of detection.")
    doubt: NotNegative = Field(
        1.0, description="Factor on `mislabel` and on the rows of `confusion`; they end at 1."
    )


class ScoreQuantiles(Document):
    """Scores of detections by their quantiles, in equal steps from the least to the greatest; straight lines between them."""

    right: tuple[Fraction, ...] = Field(
        (), description="Of actors, with the right label; none: as without quantiles."
    )
    wrong: tuple[Fraction, ...] = Field((), description="Of actors, with a wrong label; likewise.")
    false: tuple[Fraction, ...] = Field((), description="Of nothing, in place of false_score; likewise.")

    @model_validator(mode="after")
    def _quantiles_are_in_order(self) -> Self:
        for field in ("right", "wrong", "false"):
            quantiles = getattr(self, field)
            if len(quantiles) == 1:
                raise ValueError(
                    f"{field}: one quantile says nothing of the others; give the least and the greatest"
                )
            if any(later < earlier for earlier, later in itertools.pairwise(quantiles)):
                raise ValueError(
                    f"{field}: quantiles must not fall; order them from the least to the greatest"
                )
        return self


class DetectionModel(Document):
    """The error model of the simulated detector. docs/detection.md gives the formulas and the source of each
    number.
    """

    # All defaults are stated assumptions, not fits to a camera or a network (docs/detection.md). Fields that came later
    # are left out at their defaults, so that the digests of SimSpecs from before them stay as they were.
    half_height_px: Positive = Field(
        14.0, description="Apparent height at which half of all clear views are detected."
    )
    slope: Positive = Field(
        3.0, description="Steepness of the detection probability over the logarithm of apparent height."
    )
    ceiling: Fraction = Field(0.98, description="Detection probability of a large, clear object.")
    size_curve: tuple[SizePoint, ...] = added_field(
        (),
        "Replaces half_height_px, slope and ceiling: straight lines over the logarithm of the size between these "
        "points, constant beyond them. In order of size.",
    )
    class_factors: dict[str, NotNegative] = added_field(
        {},
        "Factor on the probability of detection by true label, 1 where none is given; the product ends at 1.",
    )
    fog_extinction_per_m: NotNegative = Field(
        0.00012, description="Extinction per metre at fog level 1; grows as the level squared."
    )
    rain_extinction_per_m: NotNegative = Field(
        0.0002, description="Extinction per metre for each rain level."
    )
    dust_extinction_per_m: NotNegative = added_field(
        DUST_EXTINCTION_PER_M, "Extinction per metre at dust level 1; grows as the level squared."
    )
    night_contrast: Fraction = Field(
        0.25, description="Remaining contrast when the sun is 6 degrees below the horizon."
    )
    concealment_weight: Fraction = Field(
        0.5, description="Share of the contrast that full concealment removes."
    )
    correlation_s: NotNegative = Field(
        0.8, description="Time over which misses of one object are correlated."
    )
    mislabel: Fraction = Field(
        0.25,
        description="Probability of a wrong class label at the threshold of detection; it falls to 0 for clear views.",
    )
    confusion: dict[str, dict[str, Fraction]] = added_field(
        {},
        "Probability of each wrong label at the threshold of detection, by true label. A row replaces `mislabel` "
        "for its class; an empty row means never mislabelled. Without a row: one of the asset's look-alikes, "
        "each as often (assumed).",
    )
    jitter_px: NotNegative = Field(1.5, description="Standard deviation of the edges of a bounding box.")
    jitter_share: Fraction = added_field(
        0.0, "The same as a share of the box's width or height, added in squares."
    )
    drift_px: NotNegative = added_field(
        0.0, "Standard deviation of the part of a box's displacement that lasts over frames."
    )
    drift_s: Positive = added_field(2.0, "Time over which this part is correlated.")
    false_per_frame: NotNegative = Field(0.01, description="Mean number of false detections in one frame.")
    false_persistence_s: NotNegative = added_field(
        0.0, "Mean time for which a false detection stays in the picture; 0: a single frame."
    )
    false_labels: dict[str, Fraction] = added_field(
        {}, "Share of each label among false detections; none: every label that can be one, as often."
    )
    false_score: float = added_field(
        FALSE_SCORE_MEAN,
        "Mean score of false detections: a beta distribution whose parameters add up to 7.",
        gt=0.0,
        lt=1.0,
    )
    scores: ScoreQuantiles = added_field(
        ScoreQuantiles(),
        "Quantiles of the scores, in place of those that follow from the odds of a wrong label.",
    )
    latency_s: NotNegative = Field(0.1, le=5.0, description="Delay from exposure to publication.")
    latency_jitter_s: NotNegative = added_field(
        0.0, "Greatest additional delay of a frame; each is uniform between 0 and this.", le=5.0
    )
    id_switches_per_s: NotNegative = added_field(
        0.0, "Rate at which the track id of a detected object changes."
    )

    @model_validator(mode="after")
    def _points_are_in_order(self) -> Self:
        sizes = [point.px for point in self.size_curve]
        if any(later <= earlier for earlier, later in itertools.pairwise(sizes)):
            raise ValueError(
                f"size_curve: sizes must grow, and are {', '.join(f'{px:g}' for px in sizes)} px"
            )
        if self.false_labels and not sum(self.false_labels.values()) > 0.0:
            raise ValueError("false_labels: all shares are 0; leave the field out for all labels alike")
        return self

    @model_validator(mode="after")
    def _confusion_is_about_wrong_labels(self) -> Self:
        for label, row in self.confusion.items():
            if label in row:
                raise ValueError(f"confusion[{label}]: state the wrong labels only, without {label!r} itself")
            # Fractions such as 0.7 + 0.2 + 0.1 may exceed 1 by rounding.
            if sum(row.values()) > 1.0 + 1e-9:
                raise ValueError(f"confusion[{label}]: the probabilities add up to more than 1")
        return self

    @property
    def labels_by_field(self) -> dict[str, set[str]]:
        """The class labels that each field names."""
        return {
            "class_factors": {*self.class_factors},
            "confusion": {name for label, row in self.confusion.items() for name in (label, *row)},
            "false_labels": {*self.false_labels},
        }

    def extinction_per_m(self, weather: Environment) -> float:
        """Extinction by all that the weather puts into the air; with a stated visibility, the extinction that leaves it."""
        # Fog and dust count with their square: the default levels of fog then span the meteorological ranges of
        # docs/detection.md, 1300 m at level 5 and 400 m at level 9.
        if weather.visibility_m is not None:
            return LEAST_CONTRAST_DEPTH / weather.visibility_m
        return (
            self.fog_extinction_per_m * weather.fog_level**2
            + self.rain_extinction_per_m * weather.rain_level
            + self.dust_extinction_per_m * weather.dust_level**2
        )

    def fog_level(self, weather: Environment) -> float:
        """The stated level of fog; with a stated visibility the level of what rain and dust leave of it, 9 at the most."""
        if weather.visibility_m is None:
            return weather.fog_level
        others = weather.model_copy(update={"visibility_m": None})
        fog_per_m = self.extinction_per_m(weather) - self.extinction_per_m(others)
        if fog_per_m <= 0.0 or self.fog_extinction_per_m == 0.0:
            return 9.0 * (fog_per_m > 0.0)
        return min(9.0, math.sqrt(fog_per_m / self.fog_extinction_per_m))

    @property
    def longest_latency_s(self) -> float:
        """The longest time that a frame's result can take."""
        return self.latency_s + self.latency_jitter_s


DEFAULT_DETECTOR = "small"
"""The detector on pixels that ships."""

PerceptionSource = Literal["truth", "simulated", "agent", "detector"]


class Perception(Document):
    """Whose perception the agent has, and how the detections are made."""

    source: PerceptionSource = Field(
        "simulated",
        description="truth: detections without errors; simulated: with those of `model`; agent: none, the agent has a "
        "perception of its own; detector: those of the plug-in `detector` on the pictures.",
    )
    mode: Literal["perfect", "degraded"] = Field(
        "degraded",
        description="Of source simulated alone. perfect: every visible actor, the detections of source truth; degraded: with "
        "the errors of `model`.",
    )
    detector: str | None = added_field(
        None, "Of source detector alone: an entry point of group rebar.detectors; none: small."
    )
    detector_options: dict[str, JsonValue] = added_field(
        {}, "Of source detector alone: options of the plug-in, which checks them when it opens."
    )
    begin_score: Fraction = added_field(
        0.0,
        "Of source detector alone: least score with which a track begins. Detections of a track that has not reached "
        "it are left out.",
    )
    begin_detections: int = added_field(
        2,
        "Of source detector alone: a track begins with the detection of this number; those before are left out. "
        "A false detection of a single picture has no track.",
        ge=1,
        le=50,
    )
    more_cameras: tuple[RosName, ...] = added_field(
        (),
        "Names of the cameras of vehicle.more_cameras whose frames perception works on too. The main camera's always "
        "are.",
    )
    model: DetectionModel = DetectionModel()

    @property
    def detector_name(self) -> str:
        """The entry point of the detector that works on the pictures, when `source` asks for one."""
        return self.detector or DEFAULT_DETECTOR

    @property
    def on_pixels(self) -> bool:
        """Whether the bench runs a detector on the pictures."""
        return self.source == "detector"

    @property
    def error_free(self) -> bool:
        """Whether the detections are those of the truth."""
        return self.source == "truth" or (self.source == "simulated" and self.mode == "perfect")

    @property
    def by_bench(self) -> bool:
        """Whether the bench makes detections at all."""
        return self.source != "agent"
