"""Which class label a detection of an actor bears."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.contracts import LABEL_EVIDENCE, LEAST_DOUBT, CastMember
from bench.simspec import ASSETS, DetectionModel, SimSpec

from ._odds import mislabel_probability


@dataclass(frozen=True, slots=True)
class LabelOdds:
    """The wrong labels of one actor: `at_threshold` is the probability of any at the threshold of detection;
    `weights` are the labels' shares of it, empty where all are equal.
    """

    at_threshold: float
    labels: tuple[str, ...]
    weights: tuple[float, ...] = ()

    @classmethod
    def of(cls, model: DetectionModel, member: CastMember) -> LabelOdds:
        """The row of the model's confusion for the member's class, else its asset's look-alikes, evenly."""
        row: Mapping[str, float] | None = model.confusion.get(member.class_label)
        if row is None:
            confusable = member.definition.confused_with
            return cls(model.mislabel if confusable else 0.0, confusable)
        total = sum(row.values())
        # Labels that never occur must not be reachable by rounding.
        possible = {label: share for label, share in row.items() if share > 0.0}
        return cls(min(1.0, total), tuple(possible), tuple(share / total for share in possible.values()))

    def probability(self, share: float) -> float:
        """Probability of a wrong label in a view of that clarity."""
        return mislabel_probability(self.at_threshold, share)

    def wrong_label(self, uniform: float) -> str:
        """The wrong label that a uniform draw picks."""
        if not self.weights:
            return self.labels[min(int(uniform * len(self.labels)), len(self.labels) - 1)]
        reached = 0.0
        for label, weight in zip(self.labels, self.weights, strict=True):
            reached += weight
            if uniform < reached:
                return label
        return self.labels[-1]


def posterior_score(mislabel: float, wrong: bool, noise: float) -> float:
    """Posterior probability that the label is right, after one piece of noisy evidence; calibrated."""
    # Held away from 0 and 1, where no evidence could change the score.
    prior = min(1.0 - LEAST_DOUBT, max(LEAST_DOUBT, mislabel))
    evidence = (-0.5 if wrong else 0.5) * LABEL_EVIDENCE + noise
    return 1.0 / (1.0 + prior / (1.0 - prior) * math.exp(-LABEL_EVIDENCE * evidence))


def false_labels(simspec: SimSpec) -> Sequence[str]:
    """The labels that a false detection may bear."""
    assets = [*ASSETS.values(), *simspec.assets.values()]
    # Sorted, because a set has no order and the drawn index must name the same label in every process.
    return sorted({asset.class_label for asset in assets if asset.possible_false_alarm})
