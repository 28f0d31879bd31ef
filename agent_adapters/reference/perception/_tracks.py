"""Objects that the agent believes in, made of detections placed on the ground."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from bench.values import value_class

# Of the index that finds tracks near a place; no gate may be wider, or matches are missed.
CELL_M = 12.0
# Resolution of the directions from which a track was seen. Chosen, not measured.
SECTOR_DEG = 5.0
# A track of fewer frames may be a false detection. Chosen, not measured.
TENTATIVE_FRAMES = 3
# A tentative track that is not seen again for this long is forgotten. Chosen, not measured.
TENTATIVE_S = 3.0
# Neighbouring frames are not independent: this many count as one look. Chosen, not measured.
FRAMES_A_LOOK = 4.0
# More looks do not make it surer: its errors hang together. Chosen, not measured.
MOST_LOOKS = 4.0
PEOPLE = ("civilian", "combatant", "aid_worker")
# In a row that show the place of a person without the person, who has walked off. Chosen, not measured.
GONE_FRAMES = 20


@value_class(frozen=True, slots=True)
class PlacedDetection:
    """One detection placed on the ground: where, what, how sure, from which direction (radians) and range."""

    time_s: float
    east_m: float
    north_m: float
    label: str
    score: float
    bearing_rad: float
    range_m: float
    doubt_m: float = 0.0  # one sigma that trouble with the agent's own place adds
    picture_track: str = ""  # its identity over pictures; empty where nothing is to be made of it


@dataclass(slots=True)
class Track:
    """One object: its place, the votes for its class, and from where it was seen. Times are of the exposures.

    `label` is the class with the most weight, the first by name where two are equal.
    """

    number: int
    east_m: float
    north_m: float
    first_s: float
    last_s: float
    label: str = ""
    frames: int = 0
    variance_m2: float = 0.0  # of single sightings about the place, on each axis
    doubt_m: float = 0.0  # one sigma that the agent's own place added, the worst of the frames relied on
    missed: int = 0  # frames since the last sighting in which its place was in view
    votes: dict[str, float] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    sectors: set[int] = field(default_factory=set)
    recent: deque[str] = field(default_factory=lambda: deque(maxlen=12))
    exposures: deque[float] = field(default_factory=lambda: deque(maxlen=32))
    sides: dict[int, float] = field(default_factory=dict)  # the latest exposure from each sector
    picture_track: str = ""  # of the latest observation

    @property
    def id(self) -> str:
        return f"track-{self.number}"

    @property
    def place(self) -> tuple[float, float]:
        """East and north, in metres."""
        return self.east_m, self.north_m

    def share(self, label: str) -> float:
        """Share of all votes, weighted by score, that a class has."""
        total = sum(self.votes.values())
        return self.votes.get(label, 0.0) / total if total > 0.0 else 0.0

    @property
    def confidence(self) -> float:
        """How sure its class is: the share of votes, times what several looks of that mean score make
        together.

        Neighbouring frames are not independent, so `FRAMES_A_LOOK` of them count as one look, and at most
        `MOST_LOOKS`.
        """
        label = self.label
        if not label:
            return 0.0
        mean = self.votes[label] / self.counts[label]
        looks = min(max(self.counts[label] / FRAMES_A_LOOK, 1.0), MOST_LOOKS)
        return self.share(label) * (1.0 - math.pow(1.0 - min(mean, 1.0), looks))

    @property
    def streak(self) -> int:
        """How many of the latest observations in a row carry the same label, as far as remembered."""
        count = 0
        for label in reversed(self.recent):
            if label != self.recent[-1]:
                break
            count += 1
        return count

    @property
    def viewpoint_deg(self) -> float:
        """Spread of the directions it was seen from: the whole circle less its widest gap."""
        sectors = sorted(self.sectors)
        if len(sectors) < 2:
            return 0.0
        around = round(360.0 / SECTOR_DEG)
        gaps = [b - a for a, b in zip(sectors, [*sectors[1:], sectors[0] + around], strict=True)]
        return 360.0 - max(gaps) * SECTOR_DEG

    @property
    def evidence(self) -> tuple[float, ...]:
        """The exposures that its identity rests on: the latest, and one from each side."""
        return tuple(round(time_s, 3) for time_s in sorted({*self.exposures, *self.sides.values()}))

    def distance_m(self, east_m: float, north_m: float) -> float:
        return math.hypot(self.east_m - east_m, self.north_m - north_m)

    def take(self, sight: PlacedDetection) -> None:
        """Add one observation. People may walk, so their place follows faster than that of things."""
        self.frames += 1
        self.missed = 0
        gain = max(1.0 / self.frames, 0.35 if sight.label in PEOPLE else 0.1)
        apart_m2 = (sight.east_m - self.east_m) ** 2 + (sight.north_m - self.north_m) ** 2
        self.variance_m2 += gain * (apart_m2 / 2.0 - self.variance_m2)
        self.doubt_m = max(self.doubt_m, sight.doubt_m)
        self.east_m += gain * (sight.east_m - self.east_m)
        self.north_m += gain * (sight.north_m - self.north_m)
        self.last_s = sight.time_s
        self.votes[sight.label] = self.votes.get(sight.label, 0.0) + sight.score
        self.counts[sight.label] += 1
        self.label = min(self.votes, key=lambda label: (-self.votes[label], label))
        self.expose(sight.time_s, sight.bearing_rad)
        self.recent.append(sight.label)
        self.picture_track = sight.picture_track

    def expose(self, time_s: float, bearing_rad: float) -> None:
        """Remember an exposure and the direction from which it was made."""
        sector = int(math.degrees(bearing_rad) % 360.0 // SECTOR_DEG)
        self.sectors.add(sector)
        self.exposures.append(time_s)
        self.sides[sector] = time_s


class Tracks:
    """All tracks. Frame by frame, each detection joins the nearest track within its gate, or begins one."""

    def __init__(self) -> None:
        self._tracks: dict[int, Track] = {}
        self._cells: dict[tuple[int, int], list[int]] = {}
        self._next = 1

    def __iter__(self) -> Iterator[Track]:
        """In the order in which they began."""
        return iter(self._tracks.values())

    def __len__(self) -> int:
        return len(self._tracks)

    def take(self, time_s: float, sights: Sequence[PlacedDetection]) -> None:
        """Take in all detections of one exposure."""
        # Which object it was in the last picture says more than which place is nearest, among people who walk.
        held = {track.picture_track: track.number for track in self if track.picture_track}
        pairs = sorted(
            (-1.0 if held.get(sight.picture_track) == number else distance_m, index, number)
            for index, sight in enumerate(sights)
            for distance_m, number in self._candidates(sight)
        )
        taken_sights: set[int] = set()
        taken_tracks: set[int] = set()
        for _, index, number in pairs:
            if index not in taken_sights and number not in taken_tracks:
                taken_sights.add(index)
                taken_tracks.add(number)
                self._move(self._tracks[number], sights[index])
        for index, sight in enumerate(sights):
            if index not in taken_sights:
                self._begin(sight)
        self._forget(time_s)

    def miss(self, tracks: Iterable[Track]) -> None:
        """These were in view of a frame without them; people who are missed long enough have gone."""
        for track in tracks:
            track.missed += 1
            if track.missed >= GONE_FRAMES and track.label in PEOPLE:
                self._drop(track)

    def within(self, east_m: float, north_m: float, within_m: float) -> list[tuple[float, Track]]:
        """Tracks within a distance of a place, nearest first."""
        distances = ((track.distance_m(east_m, north_m), track) for track in self)
        return sorted(
            (pair for pair in distances if pair[0] <= within_m), key=lambda pair: (pair[0], pair[1].number)
        )

    def _candidates(self, sight: PlacedDetection) -> Iterable[tuple[float, int]]:
        column, row = _cell(sight.east_m, sight.north_m)
        for cell in ((c, r) for c in (column - 1, column, column + 1) for r in (row - 1, row, row + 1)):
            for number in self._cells.get(cell, ()):
                track = self._tracks[number]
                distance_m = track.distance_m(sight.east_m, sight.north_m)
                if distance_m <= gate_m(sight, sight.time_s - track.last_s):
                    yield distance_m, number

    def _begin(self, sight: PlacedDetection) -> None:
        track = Track(self._next, sight.east_m, sight.north_m, sight.time_s, sight.time_s)
        track.take(sight)
        self._tracks[track.number] = track
        self._cells.setdefault(_cell(*track.place), []).append(track.number)
        self._next += 1

    def _move(self, track: Track, sight: PlacedDetection) -> None:
        before = _cell(*track.place)
        track.take(sight)
        after = _cell(*track.place)
        if after != before:
            self._cells[before].remove(track.number)
            self._cells.setdefault(after, []).append(track.number)

    def _forget(self, time_s: float) -> None:
        forgotten = [t for t in self if t.frames < TENTATIVE_FRAMES and time_s - t.last_s > TENTATIVE_S]
        for track in forgotten:
            self._drop(track)

    def _drop(self, track: Track) -> None:
        del self._tracks[track.number]
        self._cells[_cell(*track.place)].remove(track.number)


def gate_m(sight: PlacedDetection, unseen_s: float) -> float:
    """How far from a track a detection may lie to be taken for it: wider for large, far and walking ones."""
    if sight.label in PEOPLE:
        return min(2.5 + 0.015 * sight.range_m + 1.5 * unseen_s, CELL_M)
    return min(5.0 + 0.02 * sight.range_m, CELL_M)


def _cell(east_m: float, north_m: float) -> tuple[int, int]:
    return math.floor(east_m / CELL_M), math.floor(north_m / CELL_M)


# Below one half on purpose: an object that may well be a bystander is treated as one. Chosen, not measured.
BYSTANDER_SHARE = 0.3

# One frame may be a false detection. Chosen, not measured.
BYSTANDER_FRAMES = 2


def may_be_bystander(track: Track, classes: tuple[str, ...]) -> bool:
    """Whether it was seen often enough, and often enough as one of these classes."""
    return (
        track.frames >= BYSTANDER_FRAMES and sum(track.share(label) for label in classes) >= BYSTANDER_SHARE
    )


def bystander_places(
    tracks: Iterable[Track], classes: tuple[str, ...], now_s: float, age_s: float
) -> list[tuple[float, float]]:
    """Where bystanders may be, by what was seen at most so long ago."""
    return [
        track.place for track in tracks if now_s - track.last_s <= age_s and may_be_bystander(track, classes)
    ]
