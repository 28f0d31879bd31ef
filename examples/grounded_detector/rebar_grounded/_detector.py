"""Grounding DINO, which finds what a text names, and SAM, which outlines it, through transformers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers

from bench.arrays import Bools, Floats
from bench.contracts import Detection, Pixels
from bench.perception.adapters import (
    file_digest,
    option_fault,
    read_options,
    surest_detections,
)
from bench.simspec import SimSpec

from ._options import GroundedOptions
from ._prompts import Prompt, default_prompts, phrase_of_pieces, phrase_scores


class GroundedDetector:
    """Both networks, loaded, each behind what prepares its input."""

    def __init__(
        self,
        options: GroundedOptions,
        finder: tuple[Any, Any],
        outlines: tuple[Any, Any] | None,
        version: str,
    ) -> None:
        self._options = options
        self._processor, self._model = finder
        self._outlines = outlines
        self.version = version
        self._prompt = Prompt.of(options.prompts)
        self._phrase_numbers = _phrase_numbers(self._processor.tokenizer, self._prompt, self._model)
        labels = sorted(set(self._prompt.labels))
        self._labels = labels
        self._of_label = [
            [number for number, phrase_label in enumerate(self._prompt.labels) if phrase_label == label]
            for label in labels
        ]

    def detect(self, bgr: Pixels) -> tuple[Detection, ...]:
        """What is in the picture, surest first. A score is that of the label's best phrase."""
        rgb = np.ascontiguousarray(bgr[..., ::-1])
        size_px = (bgr.shape[1], bgr.shape[0])
        inputs = self._processor(images=rgb, text=self._prompt.text, return_tensors="pt")
        with torch.inference_mode():
            outputs = self._model(**inputs.to(self._options.device))
        # What lies beyond the text is minus infinity, which the sigmoid takes to 0.
        pieces: Floats = outputs.logits[0].sigmoid().cpu().numpy().astype(np.float64)
        scores = phrase_scores(pieces, self._phrase_numbers, len(self._prompt.phrases))
        by_label = np.stack([scores[:, numbers].max(axis=1) for numbers in self._of_label], axis=1)
        best = by_label.argmax(axis=1)
        score: Floats = by_label[np.arange(len(best)), best]
        sure = score >= self._options.min_score
        shares = outputs.pred_boxes[0].cpu().numpy().astype(np.float64)[sure]
        half = shares[:, 2:] / 2.0
        boxes = np.concatenate([shares[:, :2] - half, shares[:, :2] + half], axis=1) * np.array(size_px * 2)
        detections = surest_detections(
            [self._labels[number] for number in best[sure].tolist()],
            score[sure],
            boxes,
            size_px,
            self._options.most_overlap,
            self._options.max_detections,
        )
        return detections if self._outlines is None or not detections else self._outlined(rgb, detections)

    def _outlined(self, rgb: Pixels, detections: tuple[Detection, ...]) -> tuple[Detection, ...]:
        """The detections with the boxes of SAM's masks, one mask for each."""
        assert self._outlines is not None
        processor, model = self._outlines
        prompts = [[list(detection.box) for detection in detections]]
        inputs = processor(rgb, input_boxes=prompts, return_tensors="pt")
        sizes = inputs["original_sizes"], inputs["reshaped_input_sizes"]
        with torch.inference_mode():
            outputs = model(**inputs.to(self._options.device))
        (masks,) = processor.image_processor.post_process_masks(
            outputs.pred_masks.cpu(), *(size.cpu() for size in sizes)
        )
        best = outputs.iou_scores[0].argmax(dim=1).tolist()
        return tuple(
            Detection(
                detection.class_label,
                detection.score,
                box_of_mask(np.asarray(masks[number, best[number]].numpy(), np.bool_), detection.box),
            )
            for number, detection in enumerate(detections)
        )


def box_of_mask(mask: Bools, given: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The box of a mask (h, w); the given one where the mask is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return given
    return float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1)


def open_grounded_detector(simspec: SimSpec) -> GroundedDetector:
    """The entry point `grounded` of group `rebar.detectors`.

    Raises SetupError for options that it does not know, models that cannot be loaded or are of another kind, and a device
    that is not there.
    """
    options = read_options(simspec, GroundedOptions)
    if "prompts" not in options.model_fields_set:
        options = options.model_copy(update={"prompts": default_prompts(simspec.assets)})
    if options.device == "cuda" and not torch.cuda.is_available():
        raise option_fault("device", "torch finds no CUDA device", "set device: cpu")
    # Its bars would go to the standard error of every worker.
    transformers.utils.logging.disable_progress_bar()
    processor = _load(transformers.AutoProcessor, "model", options.model)
    model = _load(
        transformers.AutoModelForZeroShotObjectDetection, "model", options.model, use_safetensors=True
    )
    if not isinstance(model, transformers.GroundingDinoForObjectDetection):
        raise option_fault(
            "model", f"{options.model} is a {type(model).__name__}", "name a Grounding DINO model"
        )
    versions = [_version_of("Grounding DINO", options.model, model)]
    outlines = None
    if options.sam is not None:
        sam = _load(transformers.SamModel, "sam", options.sam, use_safetensors=True)
        outlines = _load(transformers.SamProcessor, "sam", options.sam), sam.to(options.device).eval()
        versions.append(_version_of("SAM", options.sam, sam))
    versions += [f"transformers {transformers.__version__}", f"torch {torch.__version__}"]
    return GroundedDetector(
        options, (processor, model.to(options.device).eval()), outlines, ", ".join(versions)
    )


def _load(kind: Any, field: str, name: str, **parameters: bool) -> Any:
    """A part of a model, from a folder or from the hub. Raises SetupError.

    Weights are read as safetensors: the older format is a pickle, which can run code.
    """
    try:
        return kind.from_pretrained(name, **parameters)
    # transformers raises OSError for what is missing, and errors of all kinds for what is broken.
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise option_fault(
            field,
            f"{kind.__name__} cannot load {name!r}: {reason[0][:300]}",
            "give a folder that save_pretrained wrote (model and processor), or fetch it from the hub first: "
            f"hf download {name}",
        ) from error


def _phrase_numbers(tokenizer: Any, prompt: Prompt, model: Any) -> list[int]:
    """The phrase of each piece of the text. Raises SetupError when the text is longer than the network reads."""
    input_ids: list[int] = tokenizer(prompt.text)["input_ids"]
    most = int(model.config.max_text_len)
    if len(input_ids) > most:
        raise option_fault(
            "prompts",
            f"the text has {len(input_ids)} pieces, and the network reads {most}",
            "name fewer or shorter phrases",
        )
    numbers = phrase_of_pieces(
        input_ids, tokenizer.convert_tokens_to_ids("."), frozenset(tokenizer.all_special_ids)
    )
    silent = sorted(set(range(len(prompt.phrases))) - set(numbers))
    if silent:
        raise option_fault(
            "prompts",
            f"the tokenizer of the model knows no piece of {', '.join(repr(prompt.phrases[number]) for number in silent)}",
            "name phrases in words that it knows",
        )
    return numbers


def _version_of(kind: str, name: str, model: Any) -> str:
    """The network's name, and the digest of its weights, or the hub's revision."""
    folder = Path(name)
    files = sorted(folder.glob("*.safetensors")) if folder.is_dir() else []
    if files:
        return f"{kind} {folder.name}, SHA-256 {' '.join(file_digest(file, 'model')[:12] for file in files)}"
    revision = getattr(model.config, "_commit_hash", None)
    return f"{kind} {name}, revision {revision[:12]}" if revision else f"{kind} {name}"
