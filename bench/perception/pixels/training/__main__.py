"""Train, calibrate and evaluate the detector that ships.

python -m bench.perception.pixels.training train --cache DIR --out DIR
python -m bench.perception.pixels.training evaluate --out docs/pixel-detector.md

Training needs the dependency group `training` (torch, onnx) and takes the cache 0.2 MB for each crop.
"""

from __future__ import annotations

import argparse
import hashlib
from importlib.metadata import version
from pathlib import Path

from bench.camera import opencv_build, use_one_thread

from .._model import DOCUMENT_NAME, WEIGHTS_NAME, Calibration, ModelDocument, NetworkModel, Provenance
from ._evaluation import calibrate
from ._samples import open_samples
from ._scenes import LABELS, Split, generator_of

SEED = 20261123
SIZE_MULTIPLE_PX = 32
SCENES, CYCLES = 400, (4200,)
_FIRST_MARK, _LAST_MARK = "<!-- tables: first -->", "<!-- tables: last -->"
_CALIBRATION_SCENES, _CALIBRATION_FRAMES = 16, 10


def main() -> None:
    """Run one of the two commands."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, dest="command")
    train = commands.add_parser("train", help="render what is not in the cache, train, calibrate, write")
    train.add_argument("--seed", type=int, default=SEED, help="of scenes, weights and batches")
    train.add_argument("--scenes", type=int, default=SCENES, help="random scenes of 48 crops")
    train.add_argument(
        "--cycles",
        type=int,
        nargs="+",
        default=list(CYCLES),
        help="batches in each cycle; each gives a model",
    )
    train.add_argument("--batch", type=int, default=8, help="crops in a batch")
    train.add_argument("--cache", type=Path, required=True, help="folder for the crops")
    train.add_argument("--out", type=Path, required=True, help="folder for the weights and their document")
    evaluate = commands.add_parser("evaluate", help="write the tables of docs/pixel-detector.md")
    evaluate.add_argument("--seed", type=int, default=SEED, help="of the held-out scenes")
    evaluate.add_argument("--scenes", type=int, default=12, help="scenes under each condition")
    evaluate.add_argument("--frames", type=int, default=8, help="pictures of each scene")
    evaluate.add_argument("--model", type=Path, help="folder of the model; the one that ships when absent")
    evaluate.add_argument(
        "--out", type=Path, required=True, help="page whose tables are replaced, or a new file"
    )
    options = parser.parse_args()
    use_one_thread()
    if options.command == "train":
        _train(options)
    else:
        _evaluate(options)


def _report(line: str) -> None:
    print(line, flush=True)


def _train(options: argparse.Namespace) -> None:
    # Imported here: who evaluates needs no torch.
    from ._export import write_onnx
    from ._learning import Plan, train
    from ._network import layers_of

    samples = open_samples(options.cache, options.seed, options.scenes)
    _report(f"{len(samples)} crops, SHA-256 {samples.digest}")
    layers = layers_of(len(LABELS))
    random = generator_of(options.seed, Split.TRAINING, 2**31)
    plan = Plan(tuple(options.cycles), options.batch)
    for number, weights in enumerate(train(layers, samples, plan, random, _report), start=1):
        # Models of earlier cycles stand beside the last one: what more training would bring can be read off them.
        last = number == len(plan.cycles)
        folder = options.out if last else options.out / f"cycle-{number}"
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / WEIGHTS_NAME
        write_onnx(layers, weights, path)
        document = ModelDocument(
            weights_sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            labels=LABELS,
            size_multiple_px=SIZE_MULTIPLE_PX,
            calibration=Calibration(),
            provenance=Provenance(
                seed=options.seed,
                scenes=options.scenes,
                crops=len(samples),
                data_sha256=samples.digest,
                cycles=plan.cycles[:number],
                batch=plan.batch,
                torch=version("torch"),
                opencv=opencv_build(),
            ),
        )
        raw = NetworkModel(document, path.read_bytes())
        calibration = calibrate(raw, options.seed, _CALIBRATION_SCENES, _CALIBRATION_FRAMES, _report)
        document = document.model_copy(update={"calibration": calibration})
        (folder / DOCUMENT_NAME).write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")
        _report(f"{path}: {path.stat().st_size} bytes, SHA-256 {document.weights_sha256}")


def _evaluate(options: argparse.Namespace) -> None:
    from ._tables import tables

    text = tables(options.model, options.seed, options.scenes, options.frames, _report)
    options.out.write_text(_between_marks(options.out, text), encoding="utf-8")


def _between_marks(path: Path, text: str) -> str:
    """The file with these tables in place of those that it has, or the tables alone where there is no file."""
    if not path.exists():
        return text
    before, _, rest = path.read_text(encoding="utf-8").partition(_FIRST_MARK)
    _, _, after = rest.partition(_LAST_MARK)
    return f"{before}{_FIRST_MARK}\n\n{text}\n{_LAST_MARK}{after}"


if __name__ == "__main__":
    main()
