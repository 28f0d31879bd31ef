"""Training: batches of samples, the loss, and Adam with a falling rate, in one thread and from one seed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch
from torch.nn import functional

from bench.perception.pixels._decoding import CELL_PX, FIRST_BOX, FIRST_LABEL, OBJECT, SUBCELLS, cells_of

from ._network import Layer, Weights, apply, initial_weights, is_learned
from ._samples import CROP_PX, Sample, SampleStore, part_of
from ._scenes import GROUPS, LABELS
from ._targets import Targets, targets_of

# CenterNet's exponents (Zhou et al. 2019): hard cells count more, cells beside a centre less.
_HARD, _SOFT = 2.0, 4.0
_LABEL_WEIGHT, _PERSON_WEIGHT, _BOX_WEIGHT = 0.75, 1.6, 1.0
_MOST_MIDDLE_CELLS = 8.0
"""An object counts as often as it has cells in its middle, up to this."""
_MAX_GRADIENT = 10.0
_WEIGHT_DECAY = 1e-4
_WARM_UP_STEPS = 200
_LEAST_RATE_SHARE = 0.01
_REPORT_STEPS = 200
_CHECKPOINT_STEPS = 2000
_HARD_PART = 4
"""From the second pass on, one crop in so many comes twice: those in which most was invented when they came last."""
_JPEG_SHARE, _JPEG_QUALITIES = 0.2, (60, 98)

PART_PX = 224
"""Side of the part of a crop that one step learns from. Parts lie anywhere in their crop, so objects lie anywhere in the
cells of 4 x 4 pixels: a crop that always lay alike would be learned by heart after some passes."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How long and how fast.

    The rate stays at `rate` for the steady steps and falls to almost nothing in the falling ones ("warm-up, stable,
    decay": Hu et al. 2024, MiniCPM). So training can be cut short where it is without loss of what the fall brings.
    `averaged_steps` is the memory of the weights kept.
    """

    steady_steps: int
    falling_steps: int
    batch: int = 8
    rate: float = 2e-3
    averaged_steps: int = 150


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Averaged weights after so many steps at each kind of rate."""

    weights: Weights
    steady_steps: int
    falling_steps: int
    last: bool


def train(
    layers: tuple[Layer, ...],
    samples: SampleStore,
    plan: Plan,
    random: np.random.Generator,
    report: Callable[[str], None],
    cut_short: Callable[[], bool] = lambda: False,
) -> Iterator[Checkpoint]:
    """The weights every 2000 steps, and those at the end.

    Equal arguments give equal weights, to the bit, on one kind of processor with one build of torch. As soon as
    `cut_short` is true the rate begins to fall; the weights are those of a plan with as many steady steps.
    """
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    weights = initial_weights(layers, random)
    learned = [name for name in weights if is_learned(name)]
    for name in learned:
        if name.endswith("weight"):
            # As the cells lie in memory: a step takes a tenth less.
            weights[name] = weights[name].contiguous(memory_format=torch.channels_last)
        weights[name].requires_grad_(True)
    averaged = {name: tensor.detach().clone() for name, tensor in weights.items()}
    optimizer = torch.optim.AdamW(
        [
            {"params": [weights[n] for n in learned if n.endswith("weight")], "weight_decay": _WEIGHT_DECAY},
            {"params": [weights[n] for n in learned if not n.endswith("weight")], "weight_decay": 0.0},
        ],
        lr=plan.rate,
    )
    order = np.zeros(0, np.int64)
    invented = np.zeros(len(samples))
    losses: list[list[float]] = []
    began_s = time.monotonic()
    steady, step, last = plan.steady_steps, 0, False
    while not last:
        if step < steady and cut_short():
            steady = step
            report(f"cut short after {steady} steady steps")
        if len(order) < plan.batch:
            hardest = np.argsort(-invented, kind="stable")[: len(samples) // _HARD_PART]
            again = hardest[invented[hardest] > 0.0]
            order = np.concatenate((order, random.permutation(np.append(np.arange(len(samples)), again))))
        numbers_of_batch, order = order[: plan.batch], order[plan.batch :]
        batch = [_varied(samples.sample(int(number)), random) for number in numbers_of_batch]
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * _rate_share(step, steady, plan.falling_steps)
        cells = torch.from_numpy(np.concatenate([cells_of(sample.bgr, CELL_PX * 8) for sample in batch]))
        numbers = apply(layers, weights, cells.contiguous(memory_format=torch.channels_last), learning=True)
        *parts, of_samples = _loss(numbers, targets_of(batch))
        invented[numbers_of_batch] = of_samples.detach().numpy()
        optimizer.zero_grad(set_to_none=True)
        sum(parts).backward()
        torch.nn.utils.clip_grad_norm_([weights[name] for name in learned], _MAX_GRADIENT)
        optimizer.step()
        # A young average would remember the start for longer than there were steps.
        share = max(1.0 / (step + 1), 1.0 / plan.averaged_steps)
        with torch.no_grad():
            for name, tensor in weights.items():
                averaged[name].lerp_(tensor, share)
        losses.append([part.item() for part in parts])
        step += 1
        last = step >= steady + plan.falling_steps
        if step % _REPORT_STEPS == 0 or last:
            objects, boxes, labels = np.mean(losses[-_REPORT_STEPS:], axis=0)
            report(
                f"step {step} of {steady + plan.falling_steps}: objects {objects:.3f}, boxes {boxes:.3f}, "
                f"labels {labels:.3f}, {time.monotonic() - began_s:.0f} s"
            )
        if step % _CHECKPOINT_STEPS == 0 or last:
            copies = {name: tensor.clone() for name, tensor in averaged.items()}
            yield Checkpoint(copies, min(step, steady), max(0, step - steady), last)


def _rate_share(step: int, steady: int, falling: int) -> float:
    """A short rise, a steady rate, then half a cosine."""
    rise = min(1.0, (step + 1) / _WARM_UP_STEPS)
    along = max(0.0, (step - steady) / max(1, falling))
    return rise * (_LEAST_RATE_SHARE + (1.0 - _LEAST_RATE_SHARE) * 0.5 * (1.0 + math.cos(math.pi * along)))


def _varied(sample: Sample, random: np.random.Generator) -> Sample:
    """A part of the sample or its mirror image, a little brighter or darker in each channel."""
    left, top = (int(offset) for offset in random.integers(0, CROP_PX - PART_PX + 1, 2))
    sample = part_of(sample, left, top, PART_PX)
    bgr, boxes = sample.bgr, sample.boxes_px
    if random.random() < 0.5:
        width = bgr.shape[1]
        bgr = bgr[:, ::-1]
        boxes = np.stack((width - boxes[:, 2], boxes[:, 1], width - boxes[:, 0], boxes[:, 3]), axis=1)
    factors = np.exp(random.normal(0.0, 0.1) + random.normal(0.0, 0.03, 3))
    table = np.clip(np.arange(256)[:, None] * factors, 0, 255).astype(np.uint8)
    shaded = cv2.LUT(np.ascontiguousarray(bgr), table[None])
    if random.random() < _JPEG_SHARE:
        quality = int(random.integers(*_JPEG_QUALITIES))
        _, data = cv2.imencode(".jpg", shaded, [cv2.IMWRITE_JPEG_QUALITY, quality])
        shaded = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
    return replace(sample, bgr=np.asarray(shaded, np.uint8), boxes_px=boxes)


def _loss(numbers: Any, targets: Targets) -> tuple[Any, Any, Any, Any]:
    """Loss of the object map, of the boxes and of the labels, each for an object on average; and (n,) what each sample has
    of the first where there is no object.
    """
    count, channels, rows, columns = numbers.shape
    # (n, numbers of a cell, 2 h, 2 w): the 2 x 2 cells of a position in their places.
    split = numbers.reshape(count, 2, 2, channels // SUBCELLS, rows, columns)
    per_cell = split.permute(0, 3, 4, 1, 5, 2).reshape(count, channels // SUBCELLS, 2 * rows, 2 * columns)
    objects = max(1.0, float(targets.shares.sum()))
    logits = per_cell[:, OBJECT].float()
    peaks, weights = torch.from_numpy(targets.peaks), torch.from_numpy(targets.weights)
    likely = torch.sigmoid(logits)
    sample, row, column = torch.from_numpy(targets.cells).unbind(1)
    shares = torch.from_numpy(targets.shares)
    middles = torch.zeros_like(peaks)
    # The few middle cells of a large object stand against hundreds of others in it that look much the same.
    middles[sample, row, column] = (_MOST_MIDDLE_CELLS * shares).clamp(max=1.0)
    missed = middles * (1.0 - likely) ** _HARD * functional.softplus(-logits)
    invented = (middles == 0.0) * (1.0 - peaks) ** _SOFT * likely**_HARD * functional.softplus(logits)
    object_loss = (weights * (missed + invented)).sum() / objects
    at_cells = per_cell[sample, :, row, column]
    box_loss = (shares * _box_loss(at_cells[:, FIRST_BOX:FIRST_LABEL], row, column, targets)).sum() / objects
    weights_of_labels = [_PERSON_WEIGHT if GROUPS[label] == "person" else 1.0 for label in LABELS]
    label_losses = functional.cross_entropy(
        at_cells[:, FIRST_LABEL:],
        torch.from_numpy(targets.labels),
        torch.tensor(weights_of_labels),
        reduction="none",
    )
    label_loss = _LABEL_WEIGHT * (shares * label_losses).sum() / objects
    return object_loss, _BOX_WEIGHT * box_loss, label_loss, (weights * invented).sum(dim=(1, 2))


def _box_loss(numbers: Any, row: Any, column: Any, targets: Targets) -> Any:
    """1 - GIoU (Rezatofighi et al. 2019) of each box, and the error of the logarithm of its sides."""
    true = torch.from_numpy(targets.boxes_px) / CELL_PX
    cell = torch.stack((column, row), dim=1).float() + 0.5
    middle = cell + numbers[:, :2]
    log_sides = numbers[:, 2:].clamp(max=7.0)
    sides = log_sides.exp()
    low, high = middle - sides / 2, middle + sides / 2
    true_low, true_high = true[:, :2] - true[:, 2:] / 2, true[:, :2] + true[:, 2:] / 2
    shared = (torch.minimum(high, true_high) - torch.maximum(low, true_low)).clamp(min=0.0).prod(dim=1)
    union = sides.prod(dim=1) + true[:, 2:].prod(dim=1) - shared
    hull = (torch.maximum(high, true_high) - torch.minimum(low, true_low)).prod(dim=1)
    overlap = shared / union - (hull - union) / hull
    size_error = functional.smooth_l1_loss(log_sides, true[:, 2:].log(), reduction="none", beta=0.1).sum(
        dim=1
    )
    return 1.0 - overlap + 0.3 * size_error
