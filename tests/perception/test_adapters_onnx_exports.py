"""The detector `onnx` on exports of real networks, where their libraries are installed: torchvision, DETR and a trained YOLO."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_adapters_onnx import RUNTIMES, options_for, simspec_with

from bench.contracts import Pixels
from bench.perception.adapters import open_onnx_detector

needs_exporters = pytest.mark.skipif(
    not all(
        importlib.util.find_spec(name)
        for name in ("torch", "torchvision", "transformers", "onnx", "onnxruntime")
    ),
    reason="torch, torchvision, transformers, onnx and onnxruntime are not installed",
)


def noise(width: int, height: int) -> Pixels:
    return np.random.default_rng(4).integers(0, 256, (height, width, 3), dtype=np.uint8)


def export(network: Any, example: Any, path: Path, names: list[str]) -> Path:
    import torch

    with warnings.catch_warnings():
        # The exporter warns of itself, and of every size that it takes to be fixed.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            (example,),
            str(path),
            input_names=["picture"],
            output_names=names,
            opset_version=14,
            dynamo=False,
        )
    return path


@needs_exporters
def test_an_export_of_torchvision_gives_its_boxes(tmp_path: Path) -> None:
    """SSDlite with random weights, which does all of its own preparation and suppression, and has no axis for the batch."""
    import onnxruntime
    import torch
    import torchvision

    torch.manual_seed(0)
    network = torchvision.models.detection.ssdlite320_mobilenet_v3_large(
        weights=None, weights_backbone=None, num_classes=3, score_thresh=0.02
    ).eval()
    picture = noise(320, 320)
    tensor = torch.from_numpy(picture[..., ::-1].transpose(2, 0, 1).copy()).float() / 255.0
    weights = export(network, [tensor], tmp_path / "ssd.onnx", ["boxes", "scores", "labels"])
    labels = {"1": "combatant", "2": "civilian_vehicle"}
    options: dict[str, Any] = {
        "weights": str(weights),
        "labels": labels,
        "layout": "boxes-scores-labels",
        "input_px": [320, 320],
    }
    options |= {"runtime": "onnxruntime", "min_score": 0.02, "most_overlap": None}
    detections = open_onnx_detector(simspec_with(options)).detect(picture)
    # Not against torch: with random weights many scores are equal, and each library keeps others of equals.
    results = onnxruntime.InferenceSession(weights).run(None, {"picture": tensor.numpy()})
    boxes, scores, class_ids = (np.asarray(result) for result in results)
    shown = (scores >= 0.02) & (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    expected = zip(boxes[shown].tolist(), scores[shown].tolist(), class_ids[shown].tolist(), strict=True)
    assert len(detections) == np.count_nonzero(shown) > 5
    assert sorted((detection.box, detection.class_label) for detection in detections) == sorted(
        (tuple(box), labels[str(class_id)]) for box, _, class_id in expected
    )


@needs_exporters
@pytest.mark.parametrize("runtime", RUNTIMES)
def test_a_detr_gives_the_boxes_of_the_original(tmp_path: Path, runtime: str) -> None:
    import torch
    import transformers

    torch.manual_seed(0)
    network = transformers.DetrForObjectDetection(
        transformers.DetrConfig(
            use_timm_backbone=False, use_pretrained_backbone=False, backbone=None, d_model=32, encoder_layers=1,
            backbone_config=transformers.ResNetConfig(
                embedding_size=8, hidden_sizes=[8, 8, 8, 16], depths=[1, 1, 1, 1], out_features=["stage4"]
            ),
            decoder_layers=1, encoder_attention_heads=2, decoder_attention_heads=2, encoder_ffn_dim=32,
            decoder_ffn_dim=32, num_queries=10, num_labels=3,
        )
    ).eval()  # fmt: skip

    class Results(torch.nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, pixels: Any) -> Any:
            results = self.network(pixel_values=pixels)
            return results.logits, results.pred_boxes

    picture = noise(128, 96)
    tensor = torch.from_numpy(picture[..., ::-1].transpose(2, 0, 1)[None].copy()).float() / 255.0
    weights = export(Results().eval(), tensor, tmp_path / "detr.onnx", ["logits", "pred_boxes"])
    options: dict[str, Any] = {"weights": str(weights), "layout": "detr", "input_px": [128, 96]}
    options["labels"] = {"0": "tree", "1": "crate", "2": "tent"}
    options |= {"min_score": 0.05, "most_overlap": None, "runtime": runtime}
    detections = open_onnx_detector(simspec_with(options)).detect(picture)
    with torch.inference_mode():
        results = network(pixel_values=tensor)
    shares = results.logits.softmax(-1)[0, :, :-1]
    scores, order = shares.max(-1).values.sort(descending=True)
    assert len(detections) == 10
    assert [detection.score for detection in detections] == pytest.approx(scores.tolist(), abs=1e-4)
    for detection, place in zip(detections, order.tolist(), strict=True):
        x, y, width, height = (results.pred_boxes[0, place] * torch.tensor([128, 96, 128, 96])).tolist()
        expected = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        assert detection.box == pytest.approx(np.clip(expected, 0, [128, 96, 128, 96]), abs=0.02)


def nudenet_weights() -> Path | None:
    """YOLOv8 at 320 x 320 with 18 classes, trained by others: a file of the wheel `nudenet`, whose code is not needed."""
    wheel = importlib.util.find_spec("nudenet")
    return (
        Path(wheel.submodule_search_locations[0]) / "320n.onnx"
        if wheel and wheel.submodule_search_locations
        else None
    )


@pytest.mark.skipif(nudenet_weights() is None, reason="nudenet is not installed")
@pytest.mark.parametrize("runtime", RUNTIMES)
@pytest.mark.parametrize("size", [(640, 480), (300, 512), (320, 320)])
def test_a_trained_yolo_gives_the_boxes_of_an_independent_decoder(
    size: tuple[int, int], runtime: str
) -> None:
    """On smooth random pictures (and a photo, where matplotlib has one), down to scores that only say that the decoders agree."""
    import cv2

    weights = nudenet_weights()
    labels = {str(class_id): ("civilian", "combatant", "tree")[class_id % 3] for class_id in range(18)}
    options = options_for(
        weights or Path(), labels=labels, input_px=[320, 320], min_score=0.004, runtime=runtime
    )
    detector = open_onnx_detector(simspec_with(options))
    random = np.random.default_rng(size[0])
    small = [random.integers(0, 256, (6, 8, 3), dtype=np.uint8) for _ in range(6)]
    pictures: list[Pixels] = [
        np.asarray(cv2.resize(colours, size, interpolation=cv2.INTER_CUBIC), np.uint8) for colours in small
    ]
    if plots := importlib.util.find_spec("matplotlib"):
        photo = Path(plots.origin or "").parent / "mpl-data" / "sample_data" / "grace_hopper.jpg"
        pictures.append(np.asarray(cv2.imread(str(photo)), np.uint8))
        assert detector.detect(pictures[-1])[0].score > 0.5
    compared = 0
    for picture in pictures:
        detections = detector.detect(picture)
        expected = decoded_by_hand(str(weights), picture, labels, 0.004)
        assert [detection.class_label for detection in detections] == [label for label, _, _ in expected]
        for detection, (_, score, box) in zip(detections, expected, strict=True):
            assert detection.score == pytest.approx(score, abs=1e-3)
            assert detection.box == pytest.approx(box, abs=0.5)
        compared += len(detections)
    assert compared > 5


def decoded_by_hand(
    weights: str, picture: Pixels, labels: Mapping[str, str], min_score: float
) -> list[tuple[str, float, list[float]]]:
    """Label, score and box of what a YOLOv8 of 320 x 320 sees, surest first, one box at a time."""
    import cv2

    height, width = picture.shape[:2]
    factor = 320 / max(width, height)
    inner = (round(width * factor), round(height * factor))
    left, top = (320 - inner[0]) // 2, (320 - inner[1]) // 2
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    padded = cv2.copyMakeBorder(
        cv2.resize(picture, inner, interpolation=method),
        *(top, 320 - inner[1] - top, left, 320 - inner[0] - left),
        cv2.BORDER_CONSTANT,
        value=(114, 114, 114),
    )
    network = cv2.dnn.readNetFromONNX(weights)
    network.setInput(cv2.dnn.blobFromImage(padded, 1 / 255, swapRB=True))
    found = []
    for numbers in network.forward()[0].T.tolist():
        score = max(numbers[4:])
        if score >= min_score:
            x, y, across, down = numbers[:4]
            edges = (x - across / 2 - left, y - down / 2 - top, x + across / 2 - left, y + down / 2 - top)
            # Whole pixels: the picture lies in the input a little wider or narrower than by `factor`.
            whole = [
                edge * end / side
                for edge, end, side in zip(edges, (width, height) * 2, inner * 2, strict=True)
            ]
            ends = [min(max(edge, 0), end) for edge, end in zip(whole, (width, height) * 2, strict=True)]
            found.append((labels[str(numbers.index(score, 4) - 4)], score, ends))
    kept: list[tuple[str, float, list[float]]] = []
    for label, score, box in sorted(found, key=lambda row: -row[1]):
        if all(other != label or overlap(box, larger) <= 0.45 for other, _, larger in kept):
            kept.append((label, score, box))
    return kept


def overlap(first: list[float], second: list[float]) -> float:
    across = min(first[2], second[2]) - max(first[0], second[0])
    down = min(first[3], second[3]) - max(first[1], second[1])
    common = max(across, 0) * max(down, 0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (first, second)]
    return common / (sum(areas) - common)
