"""Tables of what a model finds on held-out scenes, in Markdown. docs/pixel-detector.md has some of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from bench.arrays import Bools, Counts
from bench.perception.pixels._detector import SmallDetector, SmallDetectorOptions
from bench.perception.pixels._model import load_model

from ._evaluation import CONDITIONS, HD, VGA, Matches, evaluate, joined
from ._scenes import GROUPS, LABELS

_SIZES_PX = (5, 8, 12, 16, 24, 32, 64, 10_000)
_SCORES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.01)
# A share of fewer cases is no figure.
_LEAST_CASES = 20

GROUP_NAMES = tuple(dict.fromkeys(GROUPS[label] for label in LABELS))
# The last place is that of -1: no label, no group.
_GROUP_OF_LABEL = np.array([GROUP_NAMES.index(GROUPS[label]) for label in LABELS] + [-1])


def tables(
    folder: Path | None, seed: int, scene_count: int, frame_count: int, report: Callable[[str], None]
) -> str:
    """All tables of the model in a folder, or of the one that ships."""
    detector = SmallDetector(load_model(folder), SmallDetectorOptions())
    by_condition = {}
    for name, conditions in CONDITIONS.items():
        by_condition[name] = evaluate(detector, seed, scene_count, frame_count, VGA, conditions)
        report(f"{name}: {len(by_condition[name].labels)} objects")
    day = next(iter(CONDITIONS.values()))
    large = evaluate(detector, seed, scene_count, frame_count, HD, day)
    # Night amplifies noise most, rain and dirt draw shapes.
    alarms = {
        name: evaluate(detector, seed, scene_count, frame_count, VGA, CONDITIONS[name], empty=True)
        for name in ("clear day", "night", "rain level 9", "noise x 5", "dirty lens 0.7")
    }
    everything = joined(list(by_condition.values()))
    clear = by_condition["clear day"]
    return (
        "\n\n".join(
            (
                "### By condition\n\n" + _conditions_table({**by_condition, "clear day, 1280x720": large}),
                "### By class\n\n" + _class_table(clear, everything),
                "### By group\n\n" + _group_table(clear, everything),
                "### By apparent size\n\n" + _size_table(clear, everything),
                "### Recall by class and condition\n\n" + _matrix(by_condition, _label_recall),
                "### Precision by class and condition\n\n" + _matrix(by_condition, _label_precision),
                "### False alarms on bare ground\n\n" + _alarm_table(alarms),
                "### Scores\n\n" + _reliability_table(everything),
            )
        )
        + "\n"
    )


def _share(right: Bools) -> str:
    return f"{right.mean():.2f}" if len(right) >= _LEAST_CASES else ""


def _groups(labels: Counts) -> Counts:
    groups: Counts = _GROUP_OF_LABEL[labels]
    return groups


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "| " + " | ".join("---" for _ in header) + " |"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _conditions_table(by_condition: dict[str, Matches]) -> str:
    return _table(
        (
            "condition",
            "objects",
            "found",
            "in the right group",
            "under the right label",
            "precision: an object",
            "its label",
        ),
        (
            (
                name,
                str(len(m.labels)),
                _share(m.detection_labels >= 0),
                _share(_groups(m.detection_labels) == _groups(m.labels)),
                _share(m.detection_labels == m.labels),
                _share(m.object_labels >= 0),
                _share(m.object_labels == m.reports),
            )
            for name, m in by_condition.items()
        ),
    )


def _label_recall(matches: Matches, label: int) -> str:
    there = matches.labels == label
    return _share(matches.detection_labels[there] == label)


def _label_precision(matches: Matches, label: int) -> str:
    of_label = matches.reports == label
    return _share(matches.object_labels[of_label] == label)


def _class_table(clear: Matches, everything: Matches) -> str:
    return _table(
        (
            "class",
            "objects",
            "found",
            "recall",
            "precision",
            "objects, all conditions",
            "found",
            "recall",
            "precision",
        ),
        (
            (
                f"`{name}`",
                *itertools.chain.from_iterable(
                    (
                        str(int((m.labels == label).sum())),
                        _share(m.detection_labels[m.labels == label] >= 0),
                        _label_recall(m, label),
                        _label_precision(m, label),
                    )
                    for m in (clear, everything)
                ),
            )
            for label, name in enumerate(LABELS)
        ),
    )


def _group_table(clear: Matches, everything: Matches) -> str:
    rows = []
    for group, name in enumerate(GROUP_NAMES):
        row = [name]
        for m in (clear, everything):
            there, of_label = _groups(m.labels) == group, _groups(m.reports) == group
            row += [
                str(int(there.sum())),
                _share(_groups(m.detection_labels)[there] == group),
                _share(_groups(m.object_labels)[of_label] == group),
            ]
        rows.append(row)
    return _table(
        ("group", "objects", "recall", "precision", "objects, all conditions", "recall", "precision"), rows
    )


def _size_table(clear: Matches, everything: Matches) -> str:
    rows = []
    for low, high in itertools.pairwise(_SIZES_PX):
        row = [f"{low} to {high - 1} px" if high < _SIZES_PX[-1] else f"{low} px and more"]
        for m in (clear, everything):
            there = (m.sizes_px >= low) & (m.sizes_px < high)
            people = there & (_groups(m.labels) == GROUP_NAMES.index("person"))
            row += [
                str(int(there.sum())),
                _share(m.detection_labels[there] >= 0),
                _share(m.detection_labels[people] >= 0),
                _share(_groups(m.detection_labels)[there] == _groups(m.labels)[there]),
                _share(m.detection_labels[there] == m.labels[there]),
            ]
        rows.append(row)
    parts = ("found", "people found", "right group", "right label")
    return _table(("longest side", "objects", *parts, "objects, all conditions", *parts), rows)


def _matrix(by_condition: dict[str, Matches], figure: Callable[[Matches, int], str]) -> str:
    return _table(
        ("condition", *(f"`{name}`" for name in LABELS)),
        (
            (condition, *(figure(matches, label) for label in range(len(LABELS))))
            for condition, matches in by_condition.items()
        ),
    )


def _alarm_table(alarms: dict[str, Matches]) -> str:
    return _table(
        ("condition", "pictures", "false alarms in a picture"),
        ((name, str(m.pictures), f"{len(m.reports) / max(1, m.pictures):.2f}") for name, m in alarms.items()),
    )


def _reliability_table(matches: Matches) -> str:
    rows = []
    for low, high in itertools.pairwise(_SCORES):
        inside = (matches.scores >= low) & (matches.scores < high)
        rows.append(
            (
                f"{low:g} to {min(high, 1.0):g}",
                str(int(inside.sum())),
                f"{matches.scores[inside].mean():.2f}" if inside.any() else "",
                _share(matches.object_labels[inside] == matches.reports[inside]),
            )
        )
    return _table(("score", "detections", "mean score", "share with the right label"), rows)
