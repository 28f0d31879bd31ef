"""Boxes over the camera's pictures, and an empty picture where a recording has none."""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache

from bench.contracts import CastMember, ViewDocument
from bench.streams import CameraInfo, CompressedImage, Detection2DArray, Header, Time

from ._messages import Color, ImageAnnotations, Point2, PointsAnnotation, PointsType, TextAnnotation
from ._shapes import ROLE_COLORS

DETECTION_COLOR = Color(1.0, 0.9, 0.1, 1.0)
TEXT_BACKGROUND = Color(0.0, 0.0, 0.0, 0.6)
BOX_PIXELS = 2.0
FONT_PIXELS = 14.0
EMPTY_PICTURE_GREY = 64
# As the SimSpec allows; a recording of a stranger may claim more.
MAX_PICTURE_PX = 8192


def detection_boxes(message: Detection2DArray) -> ImageAnnotations:
    """A box with class, score and id for each detection, and the time of exposure in the corner.

    The stamp is that of the frame: with "sync annotations" a viewer draws the boxes over the frame in which they were
    found, although they were published later.
    """
    time = message.header.stamp
    boxes, texts = [], [_caption(time, len(message.detections))]
    for detection in message.detections:
        centre, bbox = detection.bbox.center.position, detection.bbox
        left, top = centre.x - bbox.size_x / 2.0, centre.y - bbox.size_y / 2.0
        right, bottom = centre.x + bbox.size_x / 2.0, centre.y + bbox.size_y / 2.0
        boxes.append(_box(time, (left, top, right, bottom), DETECTION_COLOR))
        for result in detection.results[:1]:
            words = f"{result.hypothesis.class_id} {result.hypothesis.score:.2f} {detection.id}".rstrip()
            texts.append(_text(time, (left, top), words, DETECTION_COLOR))
    return ImageAnnotations(time, points=tuple(boxes), texts=tuple(texts))


def truth_boxes(view: ViewDocument, cast: tuple[CastMember, ...], time: Time) -> ImageAnnotations:
    """A box with the actor's name in the colour of its role for each actor that the frame shows."""
    sightings = [sighting for sighting in view.sightings if 0 <= sighting.actor < len(cast)]
    boxes, texts = [], [_caption(time, len(sightings))]
    for sighting in sightings:
        member = cast[sighting.actor]
        left, _, _, bottom = sighting.box
        boxes.append(_box(time, sighting.box, ROLE_COLORS[member.role]))
        # Below the box: the label of a detection stands above it.
        texts.append(_text(time, (left, bottom + FONT_PIXELS), member.id, ROLE_COLORS[member.role]))
    return ImageAnnotations(time, points=tuple(boxes), texts=tuple(texts))


def empty_picture(info: CameraInfo) -> CompressedImage | None:
    """A grey frame of the camera's size, on which boxes can be seen; None for a size that no camera has."""
    if not (0 < info.width <= MAX_PICTURE_PX and 0 < info.height <= MAX_PICTURE_PX):
        return None
    return CompressedImage(
        Header(info.header.stamp, info.header.frame_id), "png", _png(info.width, info.height)
    )


def _caption(time: Time, boxes: int) -> TextAnnotation:
    # Also without any box: a viewer that synchronizes waits for an annotation of each frame.
    text = f"{time.ns / 1e9:.2f} s, {boxes} {'box' if boxes == 1 else 'boxes'}"
    return _text(time, (4.0, FONT_PIXELS + 4.0), text, Color(1.0, 1.0, 1.0, 1.0))


def _text(time: Time, place: tuple[float, float], text: str, color: Color) -> TextAnnotation:
    return TextAnnotation(time, Point2(*place), text, FONT_PIXELS, color, TEXT_BACKGROUND)


def _box(time: Time, box: tuple[float, float, float, float], color: Color) -> PointsAnnotation:
    left, top, right, bottom = box
    corners = (Point2(left, top), Point2(right, top), Point2(right, bottom), Point2(left, bottom))
    return PointsAnnotation(time, PointsType.LINE_LOOP, corners, color, thickness=BOX_PIXELS)


@lru_cache(maxsize=4)
def _png(width: int, height: int) -> bytes:
    """A uniform grey picture. Written by hand: OpenCV would cost a second of start for these few bytes."""
    # Each row begins with its filter, 0 for none.
    row = b"\0" + bytes([EMPTY_PICTURE_GREY]) * width
    compressor = zlib.compressobj(9)
    pixels = b"".join([*(compressor.compress(row) for _ in range(height)), compressor.flush()])
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + _png_chunk(b"IHDR", header)
        + _png_chunk(b"IDAT", pixels)
        + _png_chunk(b"IEND", b"")
    )


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
