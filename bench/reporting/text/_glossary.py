"""The terms and statistical methods that the report explains."""

from __future__ import annotations

METHODS = {
    "clopper-pearson": "Clopper-Pearson where runs are independent",
    "korn-graubard": "Clopper-Pearson with the effective number of runs (Korn and Graubard) where runs share a design point",
    "gaffke": "for the mean of ratios above observables (Gaffke, with an added value of half weight)",
    "anytime-valid (pass rate)": "Robbins' mixture, valid for any stopping rule, for observables of one design point",
    "anytime-valid (mean)": "a mixture of exponential bets, valid for any stopping rule, for the mean elsewhere",
}


NO_INTERVAL = "none considered"


GLOSSARY = (
    ("ARL score", "How difficult a situation the agent has been shown to handle, on the scale of difficulty (0 to 100, a little "
     "more with partial credit). In one run, an observable that was achieved scores its difficulty; a node above scores the minimum "
     "of its children that have a score. Over runs it is the mean of the runs in which the node has a score: a failed run has "
     "no score and does not lower this mean. Read it only together with the confidence."),
    ("Confidence", "Of the observables under a node that a run considered, the share that was achieved; over runs, the plain mean "
     "over the runs that considered any. The interval is two-sided, 95 %."),
    ("Passed", "A run passes a node when everything under it that was considered was achieved. The count is of the runs that considered "
     "the node; the interval is of the share of such runs that pass, two-sided, 95 %, by the rule of an observable’s confidence. A principle is "
     "passed by its essential key attributes alone, which the decomposition names: that is its verdict. A run in which nothing "
     "essential was considered has none."),
    ("Raised by failure (†)", "A failed observable has no score and does not count in the mean, so failing at something easy can raise "
     "it. The mark shows that the mean is higher than it would be if every failed observable had passed exactly at its threshold."),
    ("Competence 50, 90", "The largest difficulty flown at which the pass rate, fitted so that it never rises with difficulty, is "
     "at least half, or nine tenths. "
     "Failing can never raise it. The bound is one-sided, 95 %. “≥” or “at least”: nothing harder was flown. "
     "It assumes that failures rise with difficulty, so it is given only where these runs show that."),
    ("Difficulty-response curve", "A logistic curve of the pass rate over difficulty with a pointwise 95 % band, for "
     "illustration only: the difficulty at which it passes 50 % rises when easy runs fail."),
    ("Difficulty", "Rated before anything runs, from the configured situation: each key factor (fog, concealment, bystander density "
     "and so on) has a table from value to rating; an observable's difficulty is the lowest of its factors' ratings, a node's the "
     "lowest of all its observables."),
    ("Difficulty configuration", "The difficulties of the key attributes under study, taken together. Runs that share them are "
     "in one panel."),
    ("Considered", "According to the scenario and the ground truth, the situation offered something that exercises the observable. "
     "An agent that ignores it is considered, and fails."),
    ("Scored", "At least one observable under the node was achieved (or came near enough, where the decomposition gives credit for "
     "that). “Not scored” is a separate state, neither zero nor missing."),
    ("Key attribute (KA)", "A quality that a principle requires. Below it are verifiable attribute behaviours (VAB), and below "
     "those are observables: numbers measured in a run."),
    ("Partial credit", "Four points for each unit by which the measured value exceeds the threshold."),
    ("Scene", "One design point and replicate: the same places, motions, weather and random draws, whichever agent flies."),
    ("Realization", "One SimSpec that was flown: a scene and an agent."),
    ("Mark", "The agent designates a reported target for follow-up; the rules forbid it while a bystander is nearer to the target "
     "than the no-mark distance."),
)  # fmt: skip
