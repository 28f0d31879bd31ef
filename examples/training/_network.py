"""The small network as a table of convolutions, and its work in torch.

Measured with OpenCV on one thread: it needs a third to a quarter of the time for a multiplication in convolutions of 3 x 3
with a stride of 1 that it needs in all others (75 to 90 of them in a nanosecond for 24), because it has Winograd's method for
these alone. So sizes are halved by small kernels of 2 x 2 and the rest is 3 x 3. A first convolution over three channels takes
5 to 9 ms, sorting the pixels into cells less than one. The network works at strides of 4, 8, 16 and 32 pixels and gives the
numbers of 2 x 2 cells in each position of stride 8, because few channels at a stride of 4 cost more there than many at 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from bench.perception.pixels._decoding import CELL_CHANNELS, FIRST_BOX, FIRST_LABEL, OBJECT, SUBCELLS

PICTURE = "picture"
INPUT_SCALE = 1.0 / 64.0
"""On the numbers of a cell; folded into the first layer when the network is written."""

_RUNNING_SHARE = 0.05

Weights = dict[str, Any]
"""Tensors by `layer.weight`, `.bias`, and of what is normalised `.scale`, `.mean` and `.variance`."""


@dataclass(frozen=True, slots=True)
class Layer:
    """One convolution with padding that keeps the size; then normalisation and ReLU unless it is `plain`.

    `enlarge` doubles the size of the result; `add` names a layer whose result is added before the ReLU.
    """

    name: str
    source: str
    inputs: int
    outputs: int
    kernel: int = 3
    stride: int = 1
    enlarge: bool = False
    add: str = ""
    plain: bool = False

    @property
    def padding(self) -> int:
        """Zeros at each edge: a kernel of 2 with a stride of 2 needs none."""
        return (self.kernel - 1) // 2


def layers_of(label_count: int) -> tuple[Layer, ...]:
    """The network for that many labels, in the order of its work; the last layer is its result."""
    stem, fine, middle, coarse = 32, 64, 96, 128
    return (
        Layer("stem", PICTURE, CELL_CHANNELS, stem),
        Layer("fine0", "stem", stem, fine, kernel=2, stride=2),
        Layer("fine1", "fine0", fine, fine),
        Layer("fine2", "fine1", fine, fine, add="fine0"),
        Layer("middle0", "fine2", fine, middle, kernel=2, stride=2),
        Layer("middle1", "middle0", middle, middle),
        Layer("middle2", "middle1", middle, middle, add="middle0"),
        Layer("coarse0", "middle2", middle, coarse, kernel=2, stride=2),
        Layer("coarse1", "coarse0", coarse, coarse, add="coarse0"),
        Layer("joined_middle", "coarse1", coarse, middle, kernel=1, enlarge=True, add="middle2"),
        Layer("mixed_middle", "joined_middle", middle, middle),
        Layer("joined_fine", "mixed_middle", middle, fine, kernel=1, enlarge=True, add="fine2"),
        Layer("mixed_fine", "joined_fine", fine, fine),
        Layer("sorted_fine", "mixed_fine", fine, fine),
        Layer("head", "sorted_fine", fine, SUBCELLS * (FIRST_LABEL + label_count), kernel=1, plain=True),
    )


def initial_weights(layers: tuple[Layer, ...], random: np.random.Generator) -> Weights:
    """He's initialisation, from a generator of numpy: equal on every version of torch."""
    weights: Weights = {}
    for layer in layers:
        fan_in = layer.inputs * layer.kernel**2
        shape = (layer.outputs, layer.inputs, layer.kernel, layer.kernel)
        drawn = random.standard_normal(shape) * np.sqrt((1.0 if layer.plain else 2.0) / fan_in)
        weights[f"{layer.name}.weight"] = torch.tensor(drawn, dtype=torch.float32)
        weights[f"{layer.name}.bias"] = torch.zeros(layer.outputs)
        if not layer.plain:
            for name, value in (("scale", 1.0), ("mean", 0.0), ("variance", 1.0)):
                weights[f"{layer.name}.{name}"] = torch.full((layer.outputs,), value)
    # Centres are rare: a start at their frequency (RetinaNet's rule) spares the first hundreds of steps.
    head = weights["head.bias"].view(SUBCELLS, -1)
    head[:, OBJECT] = -4.6
    # Sides of 16 pixels, between people and vehicles.
    head[:, FIRST_BOX + 2 : FIRST_LABEL] = 1.4
    return weights


def is_learned(name: str) -> bool:
    """Whether a tensor is learned by gradient; means and variances follow the data."""
    return name.rsplit(".", 1)[1] in ("weight", "bias", "scale")


def apply(layers: tuple[Layer, ...], weights: Weights, cells: Any, *, learning: bool) -> Any:
    """The network's result (n, 4 * numbers of a cell, h/8, w/8) on cells (n, 48, h/4, w/4) of pixels minus 128."""
    results = {PICTURE: cells * INPUT_SCALE}
    for layer in layers:
        name = layer.name
        result = functional.conv2d(
            results[layer.source],
            weights[f"{name}.weight"],
            weights[f"{name}.bias"] if layer.plain else None,
            layer.stride,
            layer.padding,
        )
        if not layer.plain:
            result = functional.batch_norm(
                result,
                weights[f"{name}.mean"],
                weights[f"{name}.variance"],
                weights[f"{name}.scale"],
                weights[f"{name}.bias"],
                learning,
                _RUNNING_SHARE,
            )
        if layer.enlarge:
            result = functional.interpolate(result, scale_factor=2.0, mode="nearest")
        if layer.add:
            result = result + results[layer.add]
        results[name] = result if layer.plain else functional.relu(result)
    return results[layers[-1].name]
