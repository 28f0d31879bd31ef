"""The truth as the bench hands it over, and perception that is never wrong: the detections only say when a frame was
exposed.

What an object is and where comes from the truth. A target is still known only once the camera has had it in
view, as the rules ask of every agent (docs/rulings.md, 23).
"""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path

import numpy as np

from bench.arrays import Floats
from bench.contracts import CastMember, TruthDocument, parse_document
from bench.errors import SetupError
from bench.simspec import PROTECTED_ROLES, TARGET_ROLES, SimSpec
from bench.streams import Detection2DArray

from ..reference.flight._paths import Place
from ..reference.perception._camera import GroundCamera
from ..reference.perception._perception import USEFUL_M, ObjectPerception
from ..reference.perception._pose import PoseHistory, VehiclePose
from ..reference.perception._tracks import PEOPLE, TENTATIVE_FRAMES, Track, Tracks

# The middle of a person is so high above the ground.
_MIDDLE_M = 0.9
# A minute is what `surroundings_seen` asks for, of half of the people; then margins. Chosen, not measured.
SURROUNDINGS_S, UNSEEN_SHARE = 50.0, 0.4
# Nearer to the image's edge an object may be cut off: the agent's own pose is not exact.
_EDGE = 0.06
# Looks of so long are taken together: satellite navigation of campaign standard wanders with a time of 60 s, so that
# it moves by some 0.5 m meanwhile.
WINDOW_S = 12.0
# So far off at most: four times what it wanders there. Then the grid of offsets, and how many looks have to agree.
# Chosen, not measured.
REACH_M, GRID_M, LEAST_LOOKS = 8.0, 1.0, 15


class Truth:
    """A TruthDocument with places between its rows."""

    def __init__(self, document: TruthDocument) -> None:
        self.simspec: SimSpec = document.simspec
        self.cast: tuple[CastMember, ...] = document.cast
        self.people = [index for index, member in enumerate(self.cast) if member.role in PROTECTED_ROLES]
        self._every_s = document.every_s
        self._places_m = np.array(document.places_m, dtype=np.float64).reshape(len(document.places_m), -1, 2)

    def places_m(self, time_s: float) -> Floats:
        """(n, 2) east and north of the cast at a moment."""
        row = min(max(time_s / self._every_s, 0.0), len(self._places_m) - 1.0)
        first = min(int(row), len(self._places_m) - 2)
        share = row - first
        before, after = self._places_m[first : first + 2]
        return np.asarray((1.0 - share) * before + share * after)

    def people_m(self, time_s: float) -> Floats:
        """(n, 2) those of `people`, who are not to be hurt."""
        return self.places_m(time_s)[self.people]


def load_truth(path: str) -> Truth:
    """The truth in the file that REBAR_TRUTH names. Raises SetupError where there is none."""
    file = Path(path)
    document = parse_document(TruthDocument, file.read_bytes()) if path and file.is_file() else None
    if document is None:
        remedy = "start this program through the bench, from a manifest with truth: true"
        raise SetupError("REBAR_TRUTH", "names no truth", remedy)
    return Truth(document)


class OwnError:
    """Offsets between where actors seem to be and where they are; the commonest one is its own error.

    Who is seen is not known. A wrong pair of two actors has an offset of its own, and the right pairs share one.
    """

    def __init__(self) -> None:
        self._looks: deque[tuple[float, Floats]] = deque()

    def take(self, time_s: float, seen_m: Floats, known_m: Floats) -> None:
        """One frame: places (k, 2) at which something seems to be, and the places (n, 2) of all actors."""
        offsets = (seen_m[:, None] - known_m[None]).reshape(-1, 2)
        self._looks.append((time_s, offsets[np.hypot(offsets[:, 0], offsets[:, 1]) <= REACH_M]))
        while self._looks[0][0] < time_s - WINDOW_S:
            self._looks.popleft()

    def estimate_m(self, now_s: float) -> Place | None:
        """East and north that its own position is off by; None where too few looks agree."""
        recent = [offsets for time_s, offsets in self._looks if time_s >= now_s - WINDOW_S]
        offsets = np.concatenate(recent) if recent else np.zeros((0, 2))
        if len(offsets) < LEAST_LOOKS:
            return None
        steps = round(2.0 * REACH_M / GRID_M)
        bounds = [[-REACH_M, REACH_M]] * 2
        counts, east_m, north_m = np.histogram2d(offsets[:, 0], offsets[:, 1], bins=steps, range=bounds)
        column, row = np.unravel_index(int(counts.argmax()), counts.shape)
        center = np.array([east_m[column], north_m[row]]) + GRID_M / 2.0
        # Twice, because the true offset can lie near the edge of its cell.
        for _ in range(2):
            agreeing = offsets[np.linalg.norm(offsets - center, axis=1) <= GRID_M]
            center = agreeing.mean(axis=0)
        return (float(center[0]), float(center[1])) if len(agreeing) >= LEAST_LOOKS else None


class CameraTracks(Tracks):
    """Tracks of what the camera has had in view, each with the number that it has among all."""

    def of_actor(self, known: Track) -> Track:
        """The track of an actor that is in view now, a new one the first time."""
        return self._tracks.setdefault(
            known.number,
            Track(known.number, known.east_m, known.north_m, known.last_s, known.last_s, known.label),
        )

    def frames_of(self, number: int) -> int:
        """In how many frames an actor was in view."""
        return self._tracks[number].frames if number in self._tracks else 0

    def last_s_of(self, number: int) -> float:
        """When an actor was in view last; minus infinity for one that never was."""
        return self._tracks[number].last_s if number in self._tracks else -math.inf


class TruthTracks(Tracks):
    """A track for each member of the cast, always in its true place.

    Whoever is no target counts as seen from the start: the pilot knows where people are. `published` holds tracks
    of those alone that the camera has had in view, with no more frames than it had.
    """

    def __init__(self, truth: Truth) -> None:
        super().__init__()
        self.published = CameraTracks()
        self.truth = truth
        for index, (member, (east_m, north_m)) in enumerate(
            zip(truth.cast, truth.places_m(0.0), strict=True)
        ):
            track = Track(index + 1, float(east_m), float(north_m), 0.0, 0.0, member.class_label)
            track.votes[member.class_label] = 1.0
            track.counts[member.class_label] = 1
            if member.role not in TARGET_ROLES:
                track.frames = TENTATIVE_FRAMES
            self._tracks[track.number] = track
        self.members = list(zip(self, truth.cast, strict=True))

    def advance(self, now_s: float) -> None:
        """Move everybody to where they are now."""
        places = self.truth.places_m(now_s).tolist()
        for (track, member), (east_m, north_m) in zip(self.members, places, strict=True):
            track.east_m, track.north_m = east_m, north_m
            if member.role not in TARGET_ROLES:
                track.last_s = now_s
        for track in self.published:
            track.east_m, track.north_m = places[track.number - 1]

    def see(self, index: int, time_s: float, bearing_rad: float) -> None:
        """The camera has one of the cast in view."""
        known = self._tracks[index + 1]
        for track in (known, self.published.of_actor(known)):
            track.frames += 1
            track.last_s = time_s
            track.votes[track.label] = track.votes.get(track.label, 0.0) + 1.0
            track.counts[track.label] += 1
            track.expose(time_s, bearing_rad)
            track.recent.append(track.label)

    def unseen_near(self, target: Track, within_m: float, now_s: float) -> str:
        """How many people near a target have not been in view lately; empty when enough of them have."""
        near = [track for _, track in self.within(target.east_m, target.north_m, within_m)]
        people = [t.number for t in near if t.number - 1 in self.truth.people and t is not target]
        unseen = sum(self.published.last_s_of(number) < now_s - SURROUNDINGS_S for number in people)
        return (
            f"{unseen} of {len(people)} people near it unseen" if unseen > UNSEEN_SHARE * len(people) else ""
        )


class TruthPerception(ObjectPerception):
    """The reference agent's perception, with the truth in place of what the detector says."""

    def __init__(self, poses: PoseHistory, mount: str, truth: Truth) -> None:
        super().__init__(poses, mount)
        self.truth_tracks = self.tracks = TruthTracks(truth)
        self.published = self.truth_tracks.published
        self.own_error = OwnError()
        self.truth = truth
        self._people = [index for index, member in enumerate(truth.cast) if member.class_label in PEOPLE]

    def _take(
        self, frame: Detection2DArray, time_s: float, pose: VehiclePose, camera: GroundCamera, doubt_m: float
    ) -> None:
        places, own = self.truth.places_m(time_s), (pose.east_m, pose.north_m)
        # People alone: the middle of a tree or a house is higher, which would look like an error of metres.
        middles = [
            detection.bbox.center.position
            for detection in frame.detections
            if detection.results and detection.results[0].hypothesis.class_id in PEOPLE
        ]
        points = [camera.ground_point(middle.x, middle.y, pose, _MIDDLE_M) for middle in middles]
        seen = np.array([point for point in points if point is not None], dtype=np.float64).reshape(-1, 2)
        self.own_error.take(time_s, seen, places[self._people])
        view, offset = np.array(((*own, pose.height_m, pose.yaw_rad),)), places - own
        shown = camera.in_view(places, view)[0] & (np.hypot(offset[:, 0], offset[:, 1]) < USEFUL_M)
        # A margin, by asking of places a little farther from and a little nearer to the axis of the camera.
        for factor in (1.0 - _EDGE, 1.0 + _EDGE):
            shown &= camera.in_view(own + offset * factor, view)[0]
        for index in np.flatnonzero(shown):
            self.truth_tracks.see(int(index), time_s, math.atan2(-offset[index, 0], -offset[index, 1]))
