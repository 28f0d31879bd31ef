"""Tables of what models find on held-out frames, in Markdown. docs/pixel-detector.md has some of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from bench.arrays import Bools
from bench.perception.pixels._detector import SmallDetector, SmallDetectorOptions
from bench.perception.pixels._model import load_model

from ._evaluation import CONDITIONS, HD_PX, Matches, evaluate, frames_under, joined, random_frames
from ._scenes import GROUPS, LABELS, Split

LEAST_SIZE_PX = 12
"""Longest side of the objects that the first table counts."""
_SIZES_PX = (5, 8, 12, 20, 40, 10_000)
_SCORES = np.linspace(0.0, 1.0, 11)
# A share of fewer cases is no figure.
_LEAST_CASES = 20
_PERSONS = [number for number, label in enumerate(LABELS) if GROUPS[label] == "person"]
_OWN, _OWN_HD, _RANDOM = "those of the situations", "the same, 1280x720", "random scenes, all assets"


def tables(
    folders: Sequence[Path | None], seed: int, frame_count: int, report: Callable[[str], None]
) -> tuple[str, str]:
    """All tables of the models in these folders, None for the one that ships, on the same frames; and the reliability
    diagram of the last.
    """
    detectors = [SmallDetector(load_model(folder), SmallDetectorOptions()) for folder in folders]
    names = [str(folder) if folder else "small" for folder in folders]
    sources = {
        _OWN: frames_under(None, seed, frame_count),
        _OWN_HD: frames_under(None, seed, frame_count, HD_PX),
        **{
            name: frames_under(conditions, seed, max(1, frame_count // 4))
            for name, conditions in CONDITIONS.items()
        },
        _RANDOM: random_frames(Split.EVALUATION, seed, 4 * frame_count, 6),
    }
    by_condition: dict[str, tuple[Matches, ...]] = {}
    for name, frames in sources.items():
        by_condition[name] = evaluate(detectors, frames)
        report(f"{name}: {len(by_condition[name][0].labels)} objects")
    text = "### By condition\n\n" + _condition_table(names, by_condition)
    for place, model in enumerate(names):
        missions = joined([matches[place] for name, matches in by_condition.items() if name != _RANDOM])
        random = by_condition[_RANDOM][place]
        text += f"\n\n## {model}\n\n### By apparent size\n\n{_size_table(missions, random)}"
        text += f"\n\n### By class\n\n{_class_table(missions, random)}"
        text += f"\n\n### What each was called, random scenes\n\n{_confusion_table(random)}"
        text += f"\n\n### Scores, missions\n\n{_reliability_table(missions)}"
        text += f"\n\n### Scores, random scenes\n\n{_reliability_table(random)}"
    return text + "\n", reliability_diagram({"missions": missions, "random scenes": random})


def _share(right: Bools) -> str:
    return f"{right.mean():.2f}" if len(right) >= _LEAST_CASES else ""


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "| " + " | ".join("---" for _ in header) + " |"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _found_and_named(m: Matches, wanted: Bools) -> tuple[str, str]:
    """The share of objects that are found, and of these the share with the right label."""
    found = wanted & (m.detection_labels >= 0)
    return _share(m.detection_labels[wanted] >= 0), _share((m.detection_labels == m.labels)[found])


def _condition_table(names: Sequence[str], by_condition: dict[str, tuple[Matches, ...]]) -> str:
    rows = []
    for condition, of_models in by_condition.items():
        for name, m in zip(names, of_models, strict=True):
            large = m.sizes_px >= LEAST_SIZE_PX
            person = np.isin(m.labels, _PERSONS)
            alarms = (m.object_labels < 0).sum() / m.pictures
            rows.append(
                (
                    condition,
                    name,
                    f"{m.pictures}, {large.sum()}",
                    *_found_and_named(m, large),
                    *_found_and_named(m, person & large),
                    *_found_and_named(m, person & ~large),
                    f"{alarms:.2f}",
                )
            )
    found = ("found", "named", "people found", "named", "smaller people found", "named")
    return _table(("condition", "model", "pictures, objects", *found, "false in a picture"), rows)


def _size_table(*parts: Matches) -> str:
    rows = []
    for low, high in itertools.pairwise(_SIZES_PX):
        row = [f"{low} to {high - 1} px" if high < _SIZES_PX[-1] else f"{low} px and more"]
        for m in parts:
            there = (m.sizes_px >= low) & (m.sizes_px < high)
            person = there & np.isin(m.labels, _PERSONS)
            row += [str(there.sum()), *_found_and_named(m, there), *_found_and_named(m, person)]
        rows.append(row)
    header = ("objects", "found", "named", "people found", "named")
    return _table(("longest side", *header, "random scenes: objects", *header[1:]), rows)


def _class_table(*parts: Matches) -> str:
    rows = []
    for label, name in enumerate(LABELS):
        row = [f"`{name}`"]
        for m in parts:
            there, reported = m.labels == label, m.reports == label
            alarms = (reported & (m.object_labels < 0)).sum() / m.pictures
            precision = _share(m.object_labels[reported] == label)
            row += [str(there.sum()), *_found_and_named(m, there), precision, f"{alarms:.3f}"]
        rows.append(row)
    header = ("objects", "found", "named", "precision", "false in a picture")
    return _table(("class", *header, "random scenes: objects", *header[1:]), rows)


def _confusion_table(m: Matches) -> str:
    """Of the objects of a label that are found, the shares by the label that they are given."""
    rows = []
    for label, name in enumerate(LABELS):
        found = m.detection_labels[(m.labels == label) & (m.detection_labels >= 0)]
        shares = [f"{(found == other).mean():.2f}" if len(found) else "" for other in range(len(LABELS))]
        rows.append((f"`{name}`", *shares))
    return _table(("is", *(f"`{name}`" for name in LABELS)), rows)


def _reliability(m: Matches) -> list[tuple[float, float, int, float, float]]:
    """By tenth of the score: its edges, detections in it, their mean score and the share with the right label."""
    rows = []
    for low, high in itertools.pairwise(_SCORES.tolist()):
        inside = (m.scores >= low) & (m.scores < high + (high == 1.0))
        right = (m.object_labels == m.reports)[inside]
        if len(right) >= _LEAST_CASES:
            rows.append((low, high, len(right), float(m.scores[inside].mean()), float(right.mean())))
    return rows


def _reliability_table(m: Matches) -> str:
    rows = [
        (f"{low:.1f} to {high:.1f}", str(count), f"{score:.2f}", f"{right:.2f}")
        for low, high, count, score, right in _reliability(m)
    ]
    return _table(("score", "detections", "mean score", "share with the right label"), rows)


def reliability_diagram(curves: dict[str, Matches]) -> str:
    """An SVG of the share with the right label over the score, a line for each of two curves."""
    side, edge = 240, 36
    box = f'viewBox="0 0 {side + 2 * edge} {side + 2 * edge}" font-family="sans-serif" font-size="11"'
    text = f'<svg xmlns="http://www.w3.org/2000/svg" {box}><rect width="100%" height="100%" fill="#fff"/>'
    text += f'<path d="M{edge} {edge}v{side}h{side}M{edge} {edge + side}l{side} -{side}" fill="none" stroke="#999"/>'
    for (name, matches), colour, line in zip(curves.items(), ("#1b6ca8", "#c2571a"), (0, 14), strict=True):
        points = [(edge + side * x, edge + side * (1 - y)) for *_, x, y in _reliability(matches)]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        text += f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'
        text += "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in points)
        text += f'<text x="{edge + 8}" y="{edge + 14 + line}" fill="{colour}">{name}</text>'
    for value in (0.0, 0.5, 1.0):
        text += f'<text x="{edge + side * value:.0f}" y="{edge + side + 14}" text-anchor="middle">{value:g}</text>'
        text += (
            f'<text x="{edge - 4}" y="{edge + side * (1 - value) + 4:.0f}" text-anchor="end">{value:g}</text>'
        )
    text += f'<text x="{edge + side / 2}" y="{edge + side + 28}" text-anchor="middle">score</text>'
    return text + f'<text x="{edge}" y="{edge - 8}">share with the right label</text></svg>\n'
