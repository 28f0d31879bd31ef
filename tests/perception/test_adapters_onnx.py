"""The detector `onnx`: networks put together by hand through OpenCV, and through onnxruntime where it is installed."""

from __future__ import annotations

import importlib.util
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from made_networks import BLUE_BGR, CELL_PX, RED_BGR, cells, write_network
from scipy.special import softmax

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
    corners = [{"east_m": x, "north_m": y} for x, y in ((0, 0), (50, 0), (50, 50))]
    perception = {"source": "detector", "detector": "onnx", "detector_options": dict(options)}
    return SimSpec.model_validate(
        {"name": "pixels", "world": {"area": {"corners": corners}}, "perception": perception}
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


def test_a_picture_that_fits_no_whole_number_of_times_has_its_own_factors_too(tmp_path: Path) -> None:
    """161 x 97 lies in the input as 96 x 58 below 3 grey rows: every cell of an all red picture is found."""
    weights = write_network(tmp_path / "squares.onnx", "yolo", 96, 64)
    detector = open_onnx_detector(simspec_with(options_for(weights, most_overlap=None, min_score=0.1)))
    found = sorted(detection.box for detection in detector.detect(np.full((97, 161, 3), RED_BGR, np.uint8)))
    factors = np.array([161 / 96, 97 / 58] * 2)
    inside = np.clip((cells(96, 64) - [0, 3, 0, 3]) * factors, 0, [161, 97] * 2)
    np.testing.assert_allclose(found, sorted(inside.tolist()), atol=1e-4)


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
        ({"layout": "boxes-scores-labels"}, "layout", "has output0 (1, 6, 24) (name the results so"),
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
    with pytest.raises(SetupError, match=r"options\.runtime: onnxruntime is not installed \(install it"):
        open_onnx_detector(simspec_with(options_for(weights, runtime="onnxruntime")))


@pytest.mark.parametrize(
    ("layout", "shapes", "text"),
    [
        ("yolo", {"a": (1, 6, 20), "b": (1, 6, 20)}, "the network has a (1, 6, 20), b (1, 6, 20)"),
        ("yolo", {"a": (1, 300, 6)}, "looks like (1, boxes, numbers)"),
        ("yolo", {"a": (1, 4, 20)}, "the network has a (1, 4, 20)"),
        ("yolo", {"a": (2, 6, 20)}, "the network has a (2, 6, 20)"),
        ("detr", {"logits": (1, 5, 3), "pred_boxes": (1, 6, 4)}, "pred_boxes (1, 6, 4)"),
        ("detr", {"logits": (1, 5, 1), "pred_boxes": (1, 5, 4)}, "logits (1, 5, 1)"),
        ("boxes-scores-labels", {"boxes": (5, 4), "scores": (5,)}, "three results of these names"),
        ("boxes-scores-labels", {"boxes": (5, 3), "scores": (5,), "labels": (5,)}, "boxes (5, 3)"),
    ],
)
def test_layouts_that_do_not_fit_say_what_came(
    layout: Layout, shapes: dict[str, tuple[int, ...]], text: str
) -> None:
    """The faults that only a network's results show."""
    results = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    with pytest.raises(LayoutMismatch) as raised:
        decode(layout, results, (96, 64), 0.5)
    assert text in str(raised.value)


def test_scores_of_a_detr_are_shares_with_the_last_class_none() -> None:
    """Against scipy's softmax; what is none at most, or below the least score, is left out."""
    rng = np.random.default_rng(3)
    logits, shares = rng.normal(0.0, 2.0, (40, 4)), rng.uniform(0.2, 0.4, (40, 4))
    results = {"logits": logits[None].astype(np.float32), "pred_boxes": shares[None].astype(np.float32)}
    raw = decode("detr", results, (96, 64), 0.3)
    expected = softmax(logits, axis=1)[:, :3]
    shown = expected.max(axis=1) >= 0.3
    middles, halves = shares[:, :2] * (96, 64), shares[:, 2:] * (48, 32)
    boxes = np.concatenate([middles - halves, middles + halves], axis=1)

    assert 5 < shown.sum() < 40
    np.testing.assert_array_equal(raw.class_ids, expected[shown].argmax(axis=1))
    np.testing.assert_allclose(raw.scores, expected[shown].max(axis=1), atol=1e-5)
    np.testing.assert_allclose(raw.boxes_px, boxes[shown], atol=1e-4)


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
