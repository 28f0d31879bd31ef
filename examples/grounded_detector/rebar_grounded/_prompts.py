"""From phrases to class labels, and from a text network's numbers for each piece of text to a score for each label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from bench.arrays import Floats
from bench.simspec import ASSETS, Asset


def default_prompts(own: Mapping[str, Asset] = MappingProxyType({})) -> dict[str, tuple[str, ...]]:
    """For each class label the names of its assets: `combatant` is asked for as "soldier" and "armed person"."""
    prompts: dict[str, list[str]] = {}
    for name, asset in (ASSETS | dict(own)).items():
        prompts.setdefault(asset.class_label, []).append(name.replace("-", " "))
    return {label: tuple(phrases) for label, phrases in prompts.items()}


@dataclass(frozen=True, slots=True)
class Prompt:
    """Phrases in the order of the text, and the class label of each."""

    phrases: tuple[str, ...]
    labels: tuple[str, ...]

    @classmethod
    def of(cls, prompts: Mapping[str, Sequence[str]]) -> Prompt:
        """All phrases of all labels."""
        pairs = [(phrase, label) for label, phrases in prompts.items() for phrase in phrases]
        return cls(tuple(phrase for phrase, _ in pairs), tuple(label for _, label in pairs))

    @property
    def text(self) -> str:
        """Lower case, each phrase ended by a full stop: the form that Grounding DINO was trained with."""
        return " ".join(f"{phrase}." for phrase in self.phrases)


def phrase_of_pieces(input_ids: Sequence[int], separator_id: int, special_ids: frozenset[int]) -> list[int]:
    """For each piece of the tokenised text the number of its phrase; -1 for separators and special pieces."""
    phrase, numbers = 0, []
    for piece in input_ids:
        if piece == separator_id:
            numbers.append(-1)
            phrase += 1
        else:
            numbers.append(-1 if piece in special_ids else phrase)
    return numbers


def phrase_scores(piece_scores: Floats, phrase_numbers: Sequence[int], phrases: int) -> Floats:
    """(boxes, phrases) from (boxes, pieces): a phrase scores as its best piece does, as in the authors' own evaluation.

    Pieces beyond the text are padding and count for nothing.
    """
    scores = np.zeros((len(piece_scores), phrases))
    for piece, phrase in enumerate(phrase_numbers[: piece_scores.shape[1]]):
        if 0 <= phrase < phrases:
            scores[:, phrase] = np.maximum(scores[:, phrase], piece_scores[:, piece])
    return scores
