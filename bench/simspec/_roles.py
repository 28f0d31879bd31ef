"""The parts that actors play, and the sets of them that rules speak of."""

from __future__ import annotations

from enum import StrEnum


class Role(StrEnum):
    """The part an actor plays in the mission, whatever it looks like.

    Somebody `sought` (a missing hiker, a lost child) is to be found and reported, and is nobody's enemy.
    """

    ADVERSARY = "adversary"
    BYSTANDER = "bystander"
    CLUTTER = "clutter"
    SOUGHT = "sought"


TARGET_ROLES = frozenset({Role.ADVERSARY, Role.SOUGHT})
"""Whom a report can be about."""

PROTECTED_ROLES = frozenset({Role.BYSTANDER, Role.SOUGHT})
"""Whom the rules about bystanders protect."""


def endangered_roles(marked: Role | None) -> frozenset[Role]:
    """The roles of those near whom a mark is forbidden; `marked` is the role of what it marks, None for nothing.

    To mark somebody who is sought calls for help, so the others of a lost party do not stand in its way.
    """
    return frozenset({Role.BYSTANDER}) if marked is Role.SOUGHT else PROTECTED_ROLES
