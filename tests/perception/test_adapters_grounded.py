"""The outside package of examples/grounded_detector: how it reads prompts, everywhere; with tiny models of the real architectures where torch and
transformers are installed.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_adapters_onnx import simspec_with

from bench.contracts import Pixels, VersionedDetector, plugins
from bench.errors import SetupError
from bench.perception import open_detectors
from bench.perception.adapters import read_options
from bench.simspec import ASSETS, CLASS_LABELS

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "grounded_detector"))
from rebar_grounded import GroundedOptions
from rebar_grounded._prompts import Prompt, default_prompts, phrase_of_pieces, phrase_scores

INSTALLED = all(importlib.util.find_spec(name) for name in ("torch", "transformers"))
needs_models = pytest.mark.skipif(not INSTALLED, reason="torch and transformers are not installed")

PROMPTS = {"combatant": ["soldier", "armed person"], "civilian_vehicle": ["car"], "tree": ["tree"]}
WORDS = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "soldier", "car", "tree", "armed", "person")


def test_default_prompts_name_every_asset_once() -> None:
    prompts = default_prompts()
    assert set(prompts) == set(CLASS_LABELS)
    phrases = [phrase for phrases in prompts.values() for phrase in phrases]
    assert sorted(phrases) == sorted(name.replace("-", " ") for name in ASSETS)
    assert "armed person" in prompts["combatant"]
    assert "police officer" in prompts["civilian"]
    # The defaults pass the checks that a person's prompts pass.
    assert GroundedOptions().prompts == prompts


def test_pieces_of_a_phrase_count_for_its_label_by_the_best() -> None:
    """Two boxes over the text "soldier. armed person. car.", padded to more places than it has pieces."""
    prompt = Prompt.of(PROMPTS)
    assert prompt.text == "soldier. armed person. car. tree."
    assert prompt.labels == ("combatant", "combatant", "civilian_vehicle", "tree")
    pieces = [2, 6, 5, 9, 10, 5, 7, 5, 8, 5, 3]
    numbers = phrase_of_pieces(pieces, 5, frozenset({0, 2, 3}))
    assert numbers == [-1, 0, -1, 1, 1, -1, 2, -1, 3, -1, -1]
    scores = np.zeros((2, 16))
    scores[0, [1, 3, 4, 5, 12]] = 0.1, 0.3, 0.7, 0.9, 0.95
    scores[1, [0, 6, 8]] = 0.99, 0.4, 0.2
    expected = [[0.1, 0.7, 0.0, 0.0], [0.0, 0.0, 0.4, 0.2]]
    np.testing.assert_allclose(phrase_scores(scores, numbers, 4), expected)


@needs_models
def test_boxes_of_masks_hold_their_pixels() -> None:
    """Two masks, one of a single pixel, against the smallest and largest coordinates; an empty mask changes nothing."""
    from rebar_grounded._detector import box_of_mask

    rng = np.random.default_rng(1)
    for mask in (rng.random((30, 50)) < 0.01, np.eye(30, 50, 7, dtype=bool) & (np.arange(30)[:, None] == 4)):
        pixels = [(x, y) for y in range(30) for x in range(50) if mask[y, x]]
        xs, ys = zip(*pixels, strict=True)
        assert box_of_mask(mask, (0, 0, 1, 1)) == (min(xs), min(ys), max(xs) + 1, max(ys) + 1)
    assert box_of_mask(np.zeros((4, 4), dtype=bool), (1.0, 2.0, 3.0, 4.0)) == (1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize(
    ("options", "where", "what"),
    [
        ({"prompts": {"tank": ["tank"]}}, "prompts", "'tank': no class label"),
        ({"prompts": {"tree": ["Tree"]}}, "prompts", "'Tree': write phrases in lower case"),
        ({"prompts": {"tree": ["a tree. a bush"]}}, "prompts", "without a full stop"),
        (
            {"prompts": {"tree": ["plant"], "crate": ["plant"]}},
            "prompts",
            "'plant' stands for tree and crate",
        ),
        ({"prompts": {}}, "prompts", "is not valid"),
        ({"device": "tpu"}, "device", "is not valid"),
        ({"sams": "x"}, "sams", "unknown field 'sams' (did you mean sam?)"),
    ],
)
def test_options_that_make_no_sense_are_named(options: Mapping[str, Any], where: str, what: str) -> None:
    with pytest.raises(SetupError) as raised:
        read_options(simspec_with(options), GroundedOptions)
    (fault,) = raised.value.faults
    assert fault.where == f"perception.detector_options.{where}"
    assert what in str(fault)


@pytest.mark.skipif("grounded" in plugins("rebar.detectors"), reason="the package is installed")
def test_without_the_package_the_error_says_how_to_install_it() -> None:
    spec = simspec_with({})
    spec = spec.model_copy(update={"perception": spec.perception.model_copy(update={"detector": "grounded"})})
    with pytest.raises(
        SetupError, match=r"there is no detector 'grounded' .*pip install examples/grounded_detector"
    ):
        open_detectors(spec, ())


@pytest.fixture(scope="module")
def finder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Grounding DINO of 170,000 random weights, with a tokenizer of eleven words."""
    import torch
    import transformers

    folder = tmp_path_factory.mktemp("finder")
    vocabulary = folder / "vocab.txt"
    vocabulary.write_text("\n".join(WORDS))
    config = transformers.GroundingDinoConfig(
        backbone_config=transformers.SwinConfig(
            image_size=64,
            embed_dim=8,
            depths=[1, 1, 1, 1],
            num_heads=[1, 1, 2, 2],
            window_size=4,
            out_features=["stage2", "stage3", "stage4"],
        ),
        text_config=transformers.BertConfig(
            vocab_size=len(WORDS),
            hidden_size=32,
            num_hidden_layers=1,
            num_attention_heads=2,
            intermediate_size=32,
            max_position_embeddings=64,
        ),
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        num_queries=12,
        max_text_len=24,
    )
    torch.manual_seed(0)
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    transformers.GroundingDinoProcessor(
        transformers.GroundingDinoImageProcessor(size={"shortest_edge": 96, "longest_edge": 160}),
        transformers.BertTokenizerFast(str(vocabulary)),
    ).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def outliner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A SAM of random weights, for pictures of 64 pixels."""
    import torch
    import transformers

    folder = tmp_path_factory.mktemp("outliner")
    config = transformers.SamConfig(
        vision_config={
            "hidden_size": 16, "output_channels": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "image_size": 64, "patch_size": 8, "window_size": 4, "num_pos_feats": 8, "mlp_dim": 16,
            "global_attn_indexes": [0],
        },
        prompt_encoder_config={
            "hidden_size": 16, "image_size": 64, "patch_size": 8, "mask_input_channels": 4,
        },
        mask_decoder_config={
            "hidden_size": 16, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "iou_head_hidden_dim": 16,
        },
    )  # fmt: skip
    torch.manual_seed(1)
    transformers.SamModel(config).save_pretrained(folder)
    transformers.SamProcessor(
        transformers.SamImageProcessor(
            size={"longest_edge": 64},
            pad_size={"height": 64, "width": 64},
            mask_size={"longest_edge": 32},
            mask_pad_size={"height": 32, "width": 32},
        )
    ).save_pretrained(folder)
    return folder


def noise(seed: int, size: tuple[int, int] = (160, 120)) -> Pixels:
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)


@needs_models
def test_boxes_and_scores_are_those_of_the_library(finder: Path) -> None:
    """Two pictures of two sizes against transformers' own post-processing, for phrases of one word."""
    import torch
    import transformers
    from rebar_grounded import open_grounded_detector

    prompts = {"combatant": ["soldier"], "civilian_vehicle": ["car"], "tree": ["tree"]}
    options = {"model": str(finder), "prompts": prompts, "min_score": 0.2, "most_overlap": None}
    detector = open_grounded_detector(simspec_with(options))
    version = detector.version if isinstance(detector, VersionedDetector) else ""
    assert "SHA-256" in version
    processor = transformers.AutoProcessor.from_pretrained(finder)
    model = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(finder).eval()
    for picture in (noise(1), noise(2, (96, 200))):
        detections = detector.detect(picture)
        assert detector.detect(picture) == detections
        inputs = processor(images=picture[..., ::-1].copy(), text="soldier. car. tree.", return_tensors="pt")
        with torch.inference_mode():
            outputs = model(**inputs)
        # Only the pieces of phrases: the library also counts full stops, which name nothing.
        outputs.logits = outputs.logits.clone()
        outputs.logits[..., [0, 2, 4, 6, 7]] = -torch.inf
        (expected,) = processor.post_process_grounded_object_detection(
            outputs, inputs.input_ids, threshold=0.2, text_threshold=0.2, target_sizes=[picture.shape[:2]]
        )
        assert len(detections) == len(expected["scores"]) > 3
        order = torch.argsort(-expected["scores"], stable=True)
        height, width = picture.shape[:2]
        for place, detection in zip(order.tolist(), detections, strict=True):
            assert detection.score == pytest.approx(expected["scores"][place].item(), abs=1e-5)
            box = np.clip(expected["boxes"][place].numpy(), 0.0, [width, height, width, height])
            assert detection.box == pytest.approx(box.tolist(), abs=1e-2)
            words = expected["text_labels"][place].split()
            assert any(
                detection.class_label == {"soldier": "combatant", "car": "civilian_vehicle"}.get(w, w)
                for w in words
            )


@needs_models
def test_sam_tightens_boxes_and_changes_nothing_else(finder: Path, outliner: Path) -> None:
    from rebar_grounded import open_grounded_detector

    options = {"model": str(finder), "prompts": PROMPTS, "min_score": 0.2}
    plain = open_grounded_detector(simspec_with(options))
    outlined = open_grounded_detector(simspec_with({**options, "sam": str(outliner)}))
    assert outlined.version.count("SHA-256") == 2
    for picture in (noise(1), noise(3)):
        before, after = plain.detect(picture), outlined.detect(picture)
        assert after == outlined.detect(picture)
        assert [(d.class_label, d.score) for d in before] == [(d.class_label, d.score) for d in after]
        assert [d.box for d in before] != [d.box for d in after]
        for detection in after:
            left, top, right, bottom = detection.box
            assert 0.0 <= left < right <= picture.shape[1]
            assert 0.0 <= top < bottom <= picture.shape[0]


@needs_models
def test_models_that_cannot_serve_are_refused(finder: Path, outliner: Path, tmp_path: Path) -> None:
    import torch
    from rebar_grounded import open_grounded_detector

    (tmp_path / "config.json").write_text(json.dumps({"model_type": "nonesuch"}))
    given = {"model": str(finder), "prompts": PROMPTS}
    cases: list[tuple[dict[str, Any], str]] = [
        ({**given, "model": str(tmp_path)}, r"detector_options\.model: \w+ cannot load"),
        ({**given, "model": str(outliner)}, r"detector_options\.model"),
        ({**given, "sam": str(tmp_path / "none")}, r"detector_options\.sam: SamModel cannot load"),
        # Eleven words: of the default prompts the tokenizer makes more pieces than the network reads.
        (
            {"model": str(finder)},
            r"detector_options\.prompts: the text has \d+ pieces, and the network reads 24",
        ),
    ]
    if not torch.cuda.is_available():
        cases.append(({**given, "device": "cuda"}, r"detector_options\.device: torch finds no CUDA"))
    for options, text in cases:
        with pytest.raises(SetupError, match=text):
            open_grounded_detector(simspec_with(options))
