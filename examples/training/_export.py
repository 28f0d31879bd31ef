"""The trained network as an ONNX file that OpenCV reads, and the document beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from ._network import INPUT_SCALE, PICTURE, Layer, Weights

# Old enough for OpenCV 4.11, new enough for a Resize with scales alone.
_OPSET, _IR_VERSION = 13, 8
# That of torch's batch_norm.
_VARIANCE_FLOOR = 1e-5


def write_onnx(layers: tuple[Layer, ...], weights: Weights, path: Path) -> None:
    """Write the network, with normalisation and the scale of its input folded into the convolutions.

    Equal weights give equal bytes: the graph is put together here, and holds no time and no tool's version.
    """
    nodes: list[Any] = []
    tensors = [numpy_helper.from_array(np.array((1, 1, 2, 2), np.float32), "twice")]
    for layer in layers:
        name = layer.name
        weight, bias = _folded(layer, weights)
        if layer.source == PICTURE:
            weight = weight * INPUT_SCALE
        tensors += [
            numpy_helper.from_array(weight.astype(np.float32), f"{name}.weight"),
            numpy_helper.from_array(bias.astype(np.float32), f"{name}.bias"),
        ]
        result = name if layer.plain else f"{name}.convolved"
        nodes.append(
            helper.make_node(
                "Conv",
                [layer.source, f"{name}.weight", f"{name}.bias"],
                [result],
                kernel_shape=[layer.kernel] * 2,
                strides=[layer.stride] * 2,
                pads=[layer.padding] * 4,
            )
        )
        if layer.enlarge:
            nodes.append(
                helper.make_node(
                    "Resize",
                    [result, "", "twice"],
                    [f"{name}.enlarged"],
                    mode="nearest",
                    coordinate_transformation_mode="asymmetric",
                    nearest_mode="floor",
                )
            )
            result = f"{name}.enlarged"
        if layer.add:
            nodes.append(helper.make_node("Add", [result, layer.add], [f"{name}.added"]))
            result = f"{name}.added"
        if not layer.plain:
            nodes.append(helper.make_node("Relu", [result], [name]))
    first, last = layers[0], layers[-1]
    graph = helper.make_graph(
        nodes,
        "small",
        [helper.make_tensor_value_info(PICTURE, TensorProto.FLOAT, [1, first.inputs, "rows", "columns"])],
        [
            helper.make_tensor_value_info(
                last.name, TensorProto.FLOAT, [1, last.outputs, "rows_2", "columns_2"]
            )
        ],
        tensors,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR_VERSION)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString(deterministic=True))


def _folded(layer: Layer, weights: Weights) -> tuple[Any, Any]:
    """Weight and bias of a convolution that does its normalisation as well."""
    weight = weights[f"{layer.name}.weight"].detach().double().numpy()
    bias = weights[f"{layer.name}.bias"].detach().double().numpy()
    if layer.plain:
        return weight, bias
    scale, mean, variance = (
        weights[f"{layer.name}.{part}"].detach().double().numpy() for part in ("scale", "mean", "variance")
    )
    factor = scale / np.sqrt(variance + _VARIANCE_FLOOR)
    return weight * factor[:, None, None, None], bias - mean * factor
