"""Decompositions: principles, key attributes, VABs (values, actions, behaviours) and observables that an
agent is tested on.

from decompositions import load_decomposition
decomposition = load_decomposition("search-and-report")
print(decomposition.observables_under("KA-18"))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._checks import CheckMeasure as CheckMeasure
    from ._checks import DecompositionVocabulary as DecompositionVocabulary
    from ._document import DecompositionDocument as DecompositionDocument
    from ._document import KeyAttribute as KeyAttribute
    from ._document import KeyFactor as KeyFactor
    from ._document import Level as Level
    from ._document import Observable as Observable
    from ._document import Policies as Policies
    from ._document import Principle as Principle
    from ._document import Vab as Vab
    from ._graph import Decomposition as Decomposition
    from ._graph import DecompositionNode as DecompositionNode
    from ._graph import excerpt as excerpt
    from ._load import decomposition_of as decomposition_of
    from ._load import decomposition_schema as decomposition_schema
    from ._load import load_decomposition as load_decomposition
    from ._load import read_decomposition as read_decomposition
    from ._load import shipped_decompositions as shipped_decompositions

__getattr__ = lazy_names(__name__)
