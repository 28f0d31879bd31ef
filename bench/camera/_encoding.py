"""Pictures as messages carry them, and the build of OpenCV on which their pixels rest."""

from __future__ import annotations

import hashlib

import cv2

from bench.contracts import Pixels

# The default of ROS's compressed_image_transport.
JPEG_QUALITY = 95


def encode_jpeg(bgr: Pixels) -> bytes:
    """The picture as JPEG."""
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


def opencv_build() -> str:
    """Version of OpenCV and a digest of how it was built: pictures are equal only where this is equal."""
    digest = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()
    return f"OpenCV {cv2.__version__}, build {digest[:12]}"


def use_one_thread() -> None:
    """Keep OpenCV to the calling thread, in the whole process: sessions already run one on each core."""
    cv2.setNumThreads(1)
