"""Train, calibrate and evaluate the detector that ships.

python -m examples.training train --cache DIR --out DIR
python -m examples.training evaluate --out tables.md

Training needs torch and onnx (requirements.txt) and takes the cache 0.2 MB for each crop.
"""

from __future__ import annotations

import argparse
import hashlib
import signal
from importlib.metadata import version
from pathlib import Path
from threading import Event
from types import FrameType

from bench.camera import opencv_build, use_one_thread
from bench.perception.pixels._model import (
    DOCUMENT_NAME,
    WEIGHTS_NAME,
    Calibration,
    ModelDocument,
    NetworkModel,
    Provenance,
)

from ._evaluation import calibrate
from ._samples import open_samples
from ._scenes import LABELS, Split, generator_of

SEED = 20261127
EVALUATION_SEED = 4417
SIZE_MULTIPLE_PX = 32
SCENES, STEADY_STEPS, FALLING_STEPS = 1_200, 7_160, 7_000
_CALIBRATION_SCENES, _CALIBRATION_FRAMES = 16, 10


def main() -> None:
    """Run one of the two commands."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, dest="command")
    train = commands.add_parser("train", help="render what is not in the cache, train, calibrate, write")
    train.add_argument("--seed", type=int, default=SEED, help="of scenes, weights and batches")
    train.add_argument("--scenes", type=int, default=SCENES, help="random scenes of 36 crops")
    train.add_argument(
        "--steady", type=int, default=STEADY_STEPS, help="steps at a steady rate; Ctrl-C ends them"
    )
    train.add_argument(
        "--falling", type=int, default=FALLING_STEPS, help="steps at a falling rate after them"
    )
    train.add_argument("--cache", type=Path, required=True, help="folder for the crops")
    train.add_argument("--out", type=Path, required=True, help="folder for the weights and their document")
    evaluate = commands.add_parser("evaluate", help="write tables of what a model finds")
    evaluate.add_argument("--seed", type=int, default=EVALUATION_SEED, help="of the held-out scenes")
    evaluate.add_argument("--frames", type=int, default=8, help="pictures of each situation")
    evaluate.add_argument(
        "--model",
        type=Path,
        action="append",
        help="folder of a model, repeatable; the one that ships when absent",
    )
    evaluate.add_argument(
        "--out",
        type=Path,
        required=True,
        help="file for the tables, in Markdown; the reliability diagram is written beside it",
    )
    options = parser.parse_args()
    use_one_thread()
    if options.command == "train":
        _train(options)
    else:
        _evaluate(options)


def _report(line: str) -> None:
    print(line, flush=True)


def _first_interrupt() -> Event:
    """Set by the first Ctrl-C, which begins the fall of the rate; the second one ends the process."""
    interrupted = Event()

    def note(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        interrupted.set()

    signal.signal(signal.SIGINT, note)
    return interrupted


def _train(options: argparse.Namespace) -> None:
    # Imported here: who evaluates needs no torch.
    from ._export import write_onnx
    from ._learning import Plan, train
    from ._network import layers_of

    samples = open_samples(options.cache, options.seed, options.scenes)
    _report(f"{len(samples)} crops, SHA-256 {samples.digest}")
    layers, plan = layers_of(len(LABELS)), Plan(options.steady, options.falling)
    provenance = Provenance(
        seed=options.seed,
        scenes=options.scenes,
        crops=len(samples),
        data_sha256=samples.digest,
        steady_steps=0,
        falling_steps=0,
        batch=plan.batch,
        torch=version("torch"),
        opencv=opencv_build(),
    )
    interrupted = _first_interrupt()
    options.out.mkdir(parents=True, exist_ok=True)
    random = generator_of(options.seed, Split.TRAINING, 2**31)
    # A process that dies leaves the last of these, of use but without the gain of what was still to come.
    for checkpoint in train(layers, samples, plan, random, _report, interrupted.is_set):
        write_onnx(layers, checkpoint.weights, options.out / WEIGHTS_NAME)
        steps = {"steady_steps": checkpoint.steady_steps, "falling_steps": checkpoint.falling_steps}
        raw = _write_document(options.out, provenance.model_copy(update=steps))
    calibration = calibrate(raw, options.seed, _CALIBRATION_SCENES, _CALIBRATION_FRAMES, _report)
    path = options.out / WEIGHTS_NAME
    document = raw.document.model_copy(update={"calibration": calibration})
    _report(f"{path}: {path.stat().st_size} bytes, SHA-256 {document.weights_sha256}")
    (options.out / DOCUMENT_NAME).write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")


def _write_document(folder: Path, provenance: Provenance) -> NetworkModel:
    """Write the document beside the weights in a folder, without calibration."""
    weights = (folder / WEIGHTS_NAME).read_bytes()
    document = ModelDocument(
        weights_sha256=hashlib.sha256(weights).hexdigest(),
        labels=LABELS,
        size_multiple_px=SIZE_MULTIPLE_PX,
        calibration=Calibration(),
        provenance=provenance,
    )
    (folder / DOCUMENT_NAME).write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return NetworkModel(document, weights)


def _evaluate(options: argparse.Namespace) -> None:
    from ._tables import tables

    text, diagram = tables(options.model or [None], options.seed, options.frames, _report)
    options.out.write_text(text, encoding="utf-8")
    options.out.with_suffix(".svg").write_text(diagram, encoding="utf-8")


if __name__ == "__main__":
    main()
