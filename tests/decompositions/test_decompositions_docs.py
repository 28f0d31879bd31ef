"""The page about decompositions says what is so."""

from __future__ import annotations

import re
from pathlib import Path

from bench.simspec import FACTORS
from decompositions import DecompositionVocabulary, Level, Policies, load_decomposition, read_decomposition

DOCS = Path(__file__).parents[2] / "docs"


def test_the_example_of_the_page_loads() -> None:
    """What a reader copies from the page is a whole document."""
    example = re.search(r"```yaml\n(.*?)```", (DOCS / "decompositions.md").read_text(), re.DOTALL)
    assert example
    units = {name: factor.unit for name, factor in FACTORS.items()}
    assert read_decomposition(example[1], DecompositionVocabulary(units)).name == "inspection"


def test_the_counts_of_the_page_are_right() -> None:
    """Five principles, five key attributes, twelve VABs, fourteen observables."""
    decomposition = load_decomposition("search-and-report")
    assert [len(decomposition.at_level(level)) for level in Level] == [5, 5, 12, 14]
    assert "twelve VABs, fourteen observables" in (DOCS / "decompositions.md").read_text()


def test_every_policy_is_on_the_page() -> None:
    """A rule that can be chosen is a rule that is described."""
    text = (DOCS / "scoring.md").read_text()
    assert [name for name in Policies.model_fields if f"`{name}:" not in text] == []
