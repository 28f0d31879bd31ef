"""The actors of a stage as triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Counts, Floats
from bench.contracts import Geometry, Look

VERTEX = np.dtype([("corner", "f4", 3), ("normal", "f4", 3), ("paint", "u1", 4), ("actor", "i4")])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """All triangles of all actors, three vertices each, those of one actor side by side.

    plain (n, 2) and details (n, 2): first vertex and number of vertices of each actor's faces and of its details, which lie
    on other faces and are drawn over them. middles_m (n, 3) and radii_m (n,): spheres in the actors' frames.
    """

    vertices: NDArray[np.void]
    plain: Counts
    details: Counts
    middles_m: Floats
    radii_m: Floats

    @classmethod
    def of(cls, looks: Sequence[Look]) -> Self:
        """The mesh of a cast, in its order."""
        shapes: dict[int, _Triangles] = {}
        parts, plain, details, spheres = [], [], [], []
        first = 0
        for actor, look in enumerate(looks):
            shape = shapes.get(id(look.geometry))
            if shape is None:
                shape = shapes[id(look.geometry)] = _Triangles.of(look.geometry)
            vertices = np.zeros(len(shape.faces), VERTEX)
            vertices["corner"], vertices["normal"] = shape.corners_m, shape.normals
            vertices["paint"][:, :3] = np.clip(np.rint(look.colours_bgr), 0, 255)[shape.faces]
            vertices["paint"][:, 3] = np.where(look.glows, 255, 0)[shape.faces]
            vertices["actor"] = actor
            parts.append(vertices)
            plain.append((first, shape.plain_count))
            details.append((first + shape.plain_count, len(vertices) - shape.plain_count))
            first += len(vertices)
            spheres.append((*shape.middle_m, shape.radius_m))
        sphere = np.array(spheres, dtype=np.float64).reshape(-1, 4)
        return cls(
            np.concatenate([np.zeros(0, VERTEX), *parts]),
            np.array(plain, dtype=np.int64).reshape(-1, 2),
            np.array(details, dtype=np.int64).reshape(-1, 2),
            sphere[:, :3],
            sphere[:, 3],
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    """Fans of one geometry: corners (v, 3), normals (v, 3), the face of each vertex (v,); details come last."""

    corners_m: Floats
    normals: Floats
    faces: Counts
    plain_count: int
    middle_m: Floats
    radius_m: float

    @classmethod
    def of(cls, geometry: Geometry) -> Self:
        order = np.argsort(geometry.details, kind="stable")
        corners, faces = [], []
        for face in order.tolist():
            ring = geometry.corners_m[face, : geometry.corner_counts[face]]
            fan = np.array([(0, i, i + 1) for i in range(1, len(ring) - 1)])
            triangles = ring[fan]
            # One sense of turning, so that the GPU can leave out what faces away.
            turn = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            if float((turn @ geometry.normals[face]).sum()) < 0.0:
                triangles = triangles[:, ::-1]
            corners.append(triangles.reshape(-1, 3))
            faces.append(np.full(3 * len(fan), face))
        every = geometry.corners_m.reshape(-1, 3)
        low, high = every.min(axis=0), every.max(axis=0)
        face_of = np.concatenate(faces)
        return cls(
            np.concatenate(corners),
            geometry.normals[face_of],
            face_of,
            int(np.count_nonzero(~geometry.details[face_of])),
            (low + high) / 2.0,
            float(np.linalg.norm(high - low)) / 2.0,
        )
