"""The detector `onnx`: networks put together by hand through OpenCV, and through onnxruntime where it is installed."""

from __future__ import annotations

import importlib.util
import itertools
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from made_networks import BLUE_BGR, CELL_PX, RED_BGR, write_network

from bench.arrays import Narrow
from bench.contracts import Detection, OpenPixelDetector, Pixels, VersionedDetector, load_plugin
from bench.errors import DetectorFault, SetupError
from bench.perception.adapters import OnnxDetector, OnnxOptions, open_onnx_detector
from bench.perception.adapters._layouts import Layout, LayoutMismatch, decode
from bench.perception.adapters._options import surest_detections
from bench.simspec import SimSpec

LAYOUTS: tuple[Layout, ...] = get_args(Layout)
RUNTIMES = ["opencv", *(["onnxruntime"] if importlib.util.find_spec("onnxruntime") else [])]
LABELS = {"0": "combatant", "1": "civilian_vehicle"}


def simspec_with(options: Mapping[str, Any]) -> SimSpec:
    return SimSpec.model_validate(
        {
            "name": "pixels",
            "world": {
                "area": {
                    "corners": [{"east_m": x, "north_m": y} for x, y in ((0, 0), (50, 0), (50, 50))],
                }
            },
            "perception": {"source": "detector", "detector": "onnx", "detector_options": dict(options)},
        }
    )


def options_for(weights: Path, layout: Layout = "yolo", **options: Any) -> dict[str, Any]:
    return {"weights": str(weights), "labels": LABELS, "layout": layout, "input_px": [96, 64], **options}


def picture_with(squares: Mapping[tuple[int, int], tuple[int, int, int]], size: tuple[int, int]) -> Pixels:
    """A grey picture of this width and height with coloured squares of two cells' side at these corners."""
    picture = np.full((size[1], size[0], 3), 114, np.uint8)
    for (x, y), colour in squares.items():
        picture[y : y + 2 * CELL_PX, x : x + 2 * CELL_PX] = colour
    return picture


@pytest.mark.parametrize(("layout", "runtime"), list(itertools.product(LAYOUTS, RUNTIMES)))
def test_boxes_come_back_to_where_the_objects_are(tmp_path: Path, layout: Layout, runtime: str) -> None:
    """A letterboxed and a stretched picture of twice the size: one cell of the network is two in the picture."""
    weights = write_network(tmp_path / "squares.onnx", layout, 96, 64)
    options = options_for(weights, layout, runtime=runtime, min_score=0.6)
    # 160 x 128: half of it leaves 8 grey columns on either side. 192 x 128: fits as it is.
    for size, left in (((160, 128), 16), ((192, 128), 0)):
        picture = picture_with({(64 - left, 32): RED_BGR, (96 - left, 96): BLUE_BGR}, size)
        original = picture.copy()
        detector = open_onnx_detector(simspec_with({**options, "letterbox": left > 0}))
        detections = detector.detect(picture)
        assert np.array_equal(picture, original)
        boxes = {detection.class_label: detection.box for detection in detections}
        assert set(boxes) == {"combatant", "civilian_vehicle"}
        # Single precision.
        assert boxes["combatant"] == pytest.approx((64.0 - left, 32.0, 96.0 - left, 64.0), abs=1e-4)
        assert boxes["civilian_vehicle"] == pytest.approx((96.0 - left, 96.0, 128.0 - left, 128.0), abs=1e-4)
        assert all(detection.score > 0.9 and detection.track == "" for detection in detections)
        assert detector.detect(picture) == detections


def test_stretched_pictures_keep_their_own_factors(tmp_path: Path) -> None:
    """48 x 128 in 96 x 64: columns doubled, rows halved."""
    weights = write_network(tmp_path / "squares.onnx", "yolo", 96, 64)
    picture = np.full((128, 48, 3), 114, np.uint8)
    picture[32:64, 16:24] = RED_BGR
    detector = open_onnx_detector(simspec_with(options_for(weights, letterbox=False)))
    assert [detection.box for detection in detector.detect(picture)] == [(16.0, 32.0, 24.0, 64.0)]


def test_colours_scale_and_deviation_reach_the_network(tmp_path: Path) -> None:
    """With the channels exchanged red is blue; twice the deviation is half the score."""
    weights = write_network(tmp_path / "squares.onnx", "yolo", 96, 64)
    picture = picture_with({(32, 32): RED_BGR}, (96, 64))

    def detected(**options: Any) -> list[tuple[str, float]]:
        detector = open_onnx_detector(simspec_with(options_for(weights, most_overlap=None, **options)))
        return [(detection.class_label, round(detection.score, 3)) for detection in detector.detect(picture)]

    assert detected() == [("combatant", 1.0)] * 4
    assert detected(channels="bgr") == [("civilian_vehicle", 1.0)] * 4
    assert detected(deviation=[2.0, 2.0, 2.0]) == [("combatant", 0.5)] * 4
    assert detected(scale=0.7 / 255.0, max_detections=3) == [("combatant", 0.7)] * 3
    # Red lowered by 0.3, green and blue raised: 0.7 - 0.1 - 0.1.
    assert detected(mean=[0.3, -0.1, -0.1]) == [("combatant", 0.5)] * 4
    assert detected(labels={"1": "crate"}) == []


def test_version_names_weights_and_library(tmp_path: Path) -> None:
    """Two files, two versions; the entry point opens the same detector."""
    first = write_network(tmp_path / "a.onnx", "yolo", 96, 64)
    second = write_network(tmp_path / "b.onnx", "detr", 96, 64)
    opener: OpenPixelDetector = load_plugin("rebar.detectors", "onnx")
    detectors = [
        opener(simspec_with(options_for(first))),
        open_onnx_detector(simspec_with(options_for(second, "detr"))),
    ]
    versions = [detector.version for detector in detectors if isinstance(detector, VersionedDetector)]
    assert [version.split(",")[0] for version in versions] == ["a.onnx", "b.onnx"]
    assert len({version.split("SHA-256 ")[1][:12] for version in versions}) == 2
    assert all("OpenCV" in version for version in versions)


@pytest.mark.parametrize(
    ("change", "where", "message"),
    [
        ({"weights": "missing.onnx"}, "weights", "missing.onnx: there is no such file"),
        ({"weights": ""}, "weights", "is not valid"),
        ({"labels": {"0": "tank"}}, "labels", "'tank': no class label"),
        ({"labels": {"zero": "tree"}}, "labels.zero", "is not valid"),
        ({"labels": {"0": "tree", "2": "crate"}}, "labels", "the network has 2 classes, 0 to 1, and no 2"),
        ({"labels": {}}, "labels", "is not valid"),
        ({"layout": "detr"}, "layout", "the network has output0 (1, 6, 24) (name the results so"),
        (
            {"layout": "boxes-scores-labels"},
            "layout",
            "the network has output0 (1, 6, 24) (name the results so",
        ),
        ({"layout": "ssd"}, "layout", "is not valid"),
        ({"input_px": [64, 64]}, "input_px", "give the width and height with which"),
        ({"deviation": [1.0, 0.0, 1.0]}, "deviation", "each number must be above 0"),
        ({"runtime": "tensorrt"}, "runtime", "is not valid"),
        ({"min_scores": 0.5}, "min_scores", "unknown field 'min_scores' (did you mean min_score?)"),
    ],
)
def test_what_cannot_be_opened_names_the_option_and_the_fix(
    tmp_path: Path, change: Mapping[str, Any], where: str, message: str
) -> None:
    weights = write_network(tmp_path / "squares.onnx", "yolo", 96, 64)
    with pytest.raises(SetupError) as raised:
        open_onnx_detector(simspec_with({**options_for(weights), **change}))
    (fault,) = raised.value.faults
    assert fault.where == f"perception.detector_options.{where}"
    assert message in str(fault)


def test_all_wrong_options_are_named_at_once() -> None:
    with pytest.raises(SetupError) as raised:
        open_onnx_detector(simspec_with({"labels": {"0": "tank"}, "min_score": 2.0}))
    assert {fault.where.rpartition(".")[2] for fault in raised.value.faults} == {
        "weights",
        "labels",
        "min_score",
    }


@pytest.mark.parametrize("runtime", RUNTIMES)
def test_a_file_that_is_no_network_is_refused(tmp_path: Path, runtime: str) -> None:
    for name, data in (("text.onnx", b"not a network"), ("empty.onnx", b"")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SetupError, match=r"perception\.detector_options\.weights: .* cannot read"):
            open_onnx_detector(simspec_with(options_for(tmp_path / name, runtime=runtime)))


@pytest.mark.skipif("onnxruntime" in RUNTIMES, reason="onnxruntime is installed")
def test_a_missing_library_is_named(tmp_path: Path) -> None:
    weights = write_network(tmp_path / "squares.onnx", "yolo", 96, 64)
    with pytest.raises(
        SetupError, match=r"detector_options\.runtime: onnxruntime is not installed \(install it"
    ):
        open_onnx_detector(simspec_with(options_for(weights, runtime="onnxruntime")))


def test_layouts_that_do_not_fit_say_what_came() -> None:
    """The faults that only a network's results show."""

    def array(*shape: int) -> Narrow:
        return np.zeros(shape, np.float32)

    cases: list[tuple[Layout, dict[str, Narrow], str]] = [
        ("yolo", {"a": array(1, 6, 20), "b": array(1, 6, 20)}, "the network has a (1, 6, 20), b (1, 6, 20)"),
        ("yolo", {"a": array(1, 300, 6)}, "looks like (1, boxes, numbers)"),
        ("yolo", {"a": array(1, 4, 20)}, "the network has a (1, 4, 20)"),
        ("yolo", {"a": array(2, 6, 20)}, "the network has a (2, 6, 20)"),
        ("detr", {"logits": array(1, 5, 3), "pred_boxes": array(1, 6, 4)}, "pred_boxes (1, 6, 4)"),
        ("detr", {"logits": array(1, 5, 1), "pred_boxes": array(1, 5, 4)}, "logits (1, 5, 1)"),
        ("boxes-scores-labels", {"boxes": array(5, 4), "scores": array(5)}, "three results of these names"),
        (
            "boxes-scores-labels",
            {"boxes": array(5, 3), "scores": array(5), "labels": array(5)},
            "boxes (5, 3)",
        ),
    ]
    for layout, results, text in cases:
        with pytest.raises(LayoutMismatch) as raised:
            decode(layout, results, (96, 64), 0.5)
        assert text in str(raised.value)


def test_numbers_that_are_none_are_no_detections() -> None:
    """NaN and infinity in any place of any layout, among one good box."""
    valid = np.array([10.0, 10.0, 4.0, 4.0])
    for bad in (np.nan, np.inf, -np.inf):
        boxes = np.stack([valid, np.array([bad, 10.0, 4.0, 4.0]), valid + 20.0])
        scores = np.array([0.9, 0.9, np.nan])
        table = np.column_stack([boxes, scores, np.zeros(3), np.zeros((3, 0))])
        raw = decode("yolo", {"a": np.repeat(table, 4, axis=0).T[None].astype(np.float32)}, (96, 64), 0.5)
        detections = surest_detections(
            ["tree"] * len(raw.scores), raw.scores, raw.boxes_px, (96, 64), 0.5, 100
        )
        assert [detection.box for detection in detections] == [(8.0, 8.0, 12.0, 12.0)]
        assert detections[0].score == pytest.approx(0.9)
    lists = {"boxes": np.zeros((2, 4)), "scores": np.ones(2), "labels": np.array([np.nan, 1.0])}
    narrow = {name: values.astype(np.float32) for name, values in lists.items()}
    assert decode("boxes-scores-labels", narrow, (96, 64), 0.5).class_ids.tolist() == [-1, 1]


def test_duplicates_go_as_an_independent_reference_says() -> None:
    """Greedy suppression within each label, in plain Python, on random boxes."""
    rng = np.random.default_rng(6)

    def shared(a: tuple[float, ...], b: tuple[float, ...]) -> float:
        width = min(a[2], b[2]) - max(a[0], b[0])
        height = min(a[3], b[3]) - max(a[1], b[1])
        overlap = max(0.0, width) * max(0.0, height)
        return overlap / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - overlap)

    for _ in range(10):
        corners = rng.uniform(0.0, 80.0, (60, 2))
        boxes = np.concatenate([corners, corners + rng.uniform(5.0, 40.0, (60, 2))], axis=1)
        labels = [str(label) for label in rng.choice(["tree", "crate"], 60)]
        scores = rng.uniform(0.2, 1.0, 60)
        detections = surest_detections(labels, scores, boxes, (200, 150), 0.4, 1000)
        expected: list[Detection] = []
        for place in sorted(range(60), key=lambda place: -scores[place]):
            candidate = Detection(labels[place], float(scores[place]), tuple(boxes[place].tolist()))
            if all(
                index.class_label != candidate.class_label or shared(index.box, candidate.box) <= 0.4
                for index in expected
            ):
                expected.append(candidate)
        assert [(d.class_label, d.box) for d in detections] == [(d.class_label, d.box) for d in expected]
        assert surest_detections(labels, scores, boxes, (200, 150), None, 7) == tuple(
            sorted(surest_detections(labels, scores, boxes, (200, 150), None, 60), key=lambda d: -d.score)[:7]
        )


class BrokenRuntime:
    """Computes the first picture, and then no longer what it did."""

    version = "broken 1"

    def __init__(self) -> None:
        self.runs = 0

    def run(self, pictures: Narrow) -> dict[str, Narrow]:
        self.runs += 1
        return {"output0": np.zeros((1, 6, 24) if self.runs == 1 else (1, 30, 24), np.float32)}


def test_a_network_that_changes_its_mind_is_a_fault_of_the_detector() -> None:
    options = OnnxOptions.model_validate(options_for(Path("a.onnx")))
    detector = OnnxDetector(options, BrokenRuntime(), "0" * 64)
    detector.try_out()
    with pytest.raises(DetectorFault, match="looks like"):
        detector.detect(np.zeros((64, 96, 3), np.uint8))


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
