"""Pictures as messages carry them, and the build of OpenCV on which their pixels rest."""

from __future__ import annotations

import hashlib

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arrays import Narrow
from bench.contracts import Labels, Pixels

# The default of ROS's compressed_image_transport.
JPEG_QUALITY = 95
# Chosen: noise costs most of the bytes, and nothing shows of it on a page.
PAGE_JPEG_QUALITY = 80

_TIFF_DEFLATE, _TIFF_FLOAT_PREDICTOR = 8, 3


def encode_jpeg(bgr: Pixels) -> bytes:
    """The picture as JPEG."""
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


def encode_mask(labels: Labels) -> bytes:
    """An instance mask as a PNG of 16 bits."""
    _, data = cv2.imencode(".png", labels)
    return data.tobytes()


def encode_depth(depth_m: Narrow) -> bytes:
    """Depths as a TIFF of 32-bit floats, exact."""
    # Predictor 3 is that of floats (TIFF Technical Note 3): deflate alone needs a fifth more.
    settings = [
        cv2.IMWRITE_TIFF_COMPRESSION,
        _TIFF_DEFLATE,
        cv2.IMWRITE_TIFF_PREDICTOR,
        _TIFF_FLOAT_PREDICTOR,
    ]
    _, data = cv2.imencode(".tiff", depth_m, settings)
    return data.tobytes()


def decode_mask(data: bytes) -> Labels:
    """(h, w) the mask that `encode_mask` wrote. Raises ValueError for anything else."""
    mask = _decoded(data)
    if mask is None or mask.ndim != 2 or mask.dtype != np.uint16:
        raise ValueError("no picture with one channel of 16 bits")
    return mask.astype(np.uint16)


def decode_depth(data: bytes) -> Narrow:
    """(h, w) the depths in metres that `encode_depth` wrote. Raises ValueError for anything else."""
    depth_m = _decoded(data)
    if depth_m is None or depth_m.ndim != 2 or depth_m.dtype != np.float32:
        raise ValueError("no picture with one channel of 32-bit floats")
    return depth_m.astype(np.float32)


def _decoded(data: bytes) -> NDArray[np.generic] | None:
    decoded: NDArray[np.generic] | None = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return decoded


def small_jpeg(bgr: Pixels, max_width_px: int) -> bytes:
    """The picture for a page: at most so wide, and in the quality of pages."""
    height_px, width_px = bgr.shape[:2]
    if width_px > max_width_px:
        size = (max_width_px, max(1, round(height_px * max_width_px / width_px)))
        bgr = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, PAGE_JPEG_QUALITY])
    return data.tobytes()


def decode_jpeg(data: bytes) -> Pixels | None:
    """The pixels of a JPEG; None where it is none."""
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    return None if bgr is None else bgr.astype(np.uint8, copy=False)


def opencv_build() -> str:
    """Version of OpenCV and a digest of how it was built: pictures are equal only where this is equal."""
    digest = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()
    return f"OpenCV {cv2.__version__}, build {digest[:12]}"


def use_one_thread() -> None:
    """Keep OpenCV to the calling thread, in the whole process: sessions already run one on each core."""
    cv2.setNumThreads(1)
