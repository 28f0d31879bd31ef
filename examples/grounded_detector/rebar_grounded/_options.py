"""The options of the detector `grounded`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from bench.documents import Document
from bench.perception.adapters import require_class_labels

from ._prompts import default_prompts


class GroundedOptions(Document):
    """`perception.detector_options` of the detector `grounded`."""

    model: str = Field(
        "IDEA-Research/grounding-dino-tiny",
        min_length=1,
        description="Grounding DINO: a folder with a model of transformers, or a name on the Hugging Face hub.",
    )
    sam: str | None = Field(
        None,
        min_length=1,
        description="SAM, likewise: boxes become those of its masks. null: boxes stay as Grounding DINO gives them.",
    )
    prompts: Annotated[
        dict[str, tuple[Annotated[str, Field(min_length=1, max_length=80)], ...]],
        Field(
            min_length=1,
            description="Phrases by class label of the catalogue, in lower case. Default: the names of its assets.",
        ),
    ] = Field(default_factory=default_prompts)
    min_score: float = Field(0.3, gt=0.0, lt=1.0, description="Least score of a detection.")
    most_overlap: float | None = Field(
        0.7,
        gt=0.0,
        le=1.0,
        description="Of two boxes of one label that share more (intersection over union) the surer stays; null: both.",
    )
    max_detections: int = Field(100, ge=1, le=900, description="The surest so many of a picture.")
    device: Literal["cpu", "cuda"] = Field("cpu", description="Where the networks are computed.")

    @field_validator("prompts")
    @classmethod
    def _prompts_can_be_told_apart(
        cls, prompts: dict[str, tuple[str, ...]], info: ValidationInfo
    ) -> dict[str, tuple[str, ...]]:
        require_class_labels(prompts, info)
        first: dict[str, str] = {}
        for label, phrases in prompts.items():
            for phrase in phrases:
                if phrase != phrase.strip().lower() or "." in phrase:
                    raise ValueError(
                        f"{phrase!r}: write phrases in lower case, without a full stop or space around"
                    )
                if phrase in first:
                    raise ValueError(f"{phrase!r} stands for {first[phrase]} and {label}: keep one of them")
                first[phrase] = label
        return prompts
