"""The JSON documents of the truth: what the recording holds, and no agent is told unless its manifest asks for it.

Apart from those that agents read and write, because a Python agent pays for every document that it imports: these
need the whole SimSpec.
"""

from __future__ import annotations

from typing import Self

from pydantic import Field, PrivateAttr

from bench.documents import Document, added_field
from bench.simspec import ASSETS, ActorGroup, Asset, Identifier, Role, SimSpec


class CastMember(Document):
    """Who an actor is; the order of the cast is the order of positions in /truth/actors."""

    id: Identifier
    group: Identifier
    asset: Identifier
    class_label: str
    role: Role
    length_m: float
    width_m: float
    height_m: float
    concealment: float
    color: str | None = added_field(None)
    _own: Asset | None = PrivateAttr(None)

    @property
    def own(self) -> Asset | None:
        """What a SimSpec or a package says of the asset; None for one of the catalogue."""
        return self._own

    @property
    def definition(self) -> Asset:
        """The asset. Raises KeyError for one beside the catalogue's in a cast that was read from a recording."""
        return self._own or ASSETS[self.asset]

    @classmethod
    def of(cls, actor_id: str, group: ActorGroup) -> Self:
        """The member of a group whose asset is known; KeyError for another."""
        asset = group.definition
        member = cls(
            id=actor_id,
            group=group.id,
            asset=group.asset,
            class_label=asset.class_label,
            role=group.role,
            length_m=asset.length_m,
            width_m=asset.width_m,
            height_m=asset.height_m,
            concealment=group.concealment,
            color=group.color,
        )
        member._own = group.own
        return member


class CastDocument(Document):
    members: tuple[CastMember, ...]


class TruthDocument(Document):
    """Bench to an agent that is openly given the truth, as a file: the situation, and where everybody will be.

    What becomes of the vehicle is not in it.
    """

    simspec: SimSpec
    cast: tuple[CastMember, ...]
    every_s: float = Field(description="Between two rows of places, from time zero to the time limit.")
    places_m: tuple[tuple[tuple[float, float], ...], ...] = Field(
        description="East and north of each member of the cast, one row for each moment."
    )


class SightingDocument(Document):
    """What truth says of one actor in one camera frame."""

    actor: int = Field(description="Index into the cast.")
    range_m: float
    height_px: float = Field(description="Apparent height of the whole object.")
    visible: float = Field(
        description="Share of the object that nothing hides and that lies inside the frame."
    )
    box: tuple[float, float, float, float] = Field(
        description="left, top, right, bottom in pixels, clipped to the frame."
    )


class ViewDocument(Document):
    """Truth of one camera frame, at its exposure."""

    frame: int
    camera: str
    sightings: tuple[SightingDocument, ...]


class ActorPixelsDocument(Document):
    """What a rendered picture shows of one actor."""

    actor: int = Field(description="Index into the cast.")
    box: tuple[int, int, int, int] = Field(
        description="left, top, right, bottom in whole pixels, around its visible pixels."
    )
    visible_px: int
    visible: float = Field(description="Share of its silhouette in the picture that nothing hides.")


class PictureDocument(Document):
    """One frame of the rendered camera, at its exposure."""

    frame: int
    camera: str
    shown: int | None = Field(
        description="The frame whose picture it shows: an earlier one when the camera froze, null when it lost this frame."
    )
    sha256: str | None = Field(
        description="Of the pixels: rows from the top, each pixel blue, green, red. Null for a lost frame."
    )
    actors: tuple[ActorPixelsDocument, ...] | None = Field(
        None, description="Every actor with a visible pixel; null unless the SimSpec asks for it."
    )


class VehicleDocument(Document):
    """State of the vehicle that is not motion."""

    armed: bool
    landed: bool
    crashed: bool
    mode: str
    battery_fraction: float
    failsafe: str = ""


class EventDocument(Document):
    """One line of the session's own log."""

    name: str
    text: str = ""
