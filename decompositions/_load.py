"""Load decompositions: the shipped ones by name, any other by its path."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from bench.documents import parse_text, read_text, validate_document
from bench.errors import SetupError

from ._checks import DecompositionVocabulary, DocumentChecks, suggestion
from ._document import DecompositionDocument
from ._graph import Decomposition, graph_of

Lines = Mapping[tuple[str | int, ...], int]


def shipped_decompositions() -> tuple[str, ...]:
    """Names of the shipped decompositions."""
    files = resources.files(__package__).joinpath("data").iterdir()
    return tuple(
        sorted(
            file.name.removesuffix(".yaml").replace("_", "-") for file in files if file.name.endswith(".yaml")
        )
    )


def load_decomposition(
    name_or_path: str | Path, vocabulary: DecompositionVocabulary | None = None
) -> Decomposition:
    """Read a decomposition: a shipped one by its name (`search-and-report`), any other by its path.

    `vocabulary` has the known key factors and measures; without it those names stay unchecked.
    Raises SetupError with every fault: file, line, node, remedy.
    """
    name = str(name_or_path)
    if name in shipped_decompositions():
        # Through importlib: the package may be installed as a zip file.
        file = resources.files(__package__).joinpath("data", f"{name.replace('-', '_')}.yaml")
        return read_decomposition(file.read_text(encoding="utf-8"), vocabulary, source=name)
    # A name without a known suffix and without a file is more likely a misspelt name than a missing file.
    if Path(name).suffix.lower() not in (".yaml", ".yml", ".json") and not Path(name).exists():
        names = ", ".join(shipped_decompositions())
        raise SetupError(
            "decomposition",
            f"there is no decomposition {name!r}",
            f"{suggestion(name, shipped_decompositions())} By name: {names}; or a path",
        )
    return read_decomposition(read_text(Path(name)), vocabulary, source=name)


def read_decomposition(
    text: str, vocabulary: DecompositionVocabulary | None = None, source: str = ""
) -> Decomposition:
    """Like `load_decomposition`, for a text; `source` names it in messages."""
    value, lines = parse_text(text, source)
    if not isinstance(value, dict) or not value:
        what = (
            "the document is empty"
            if not value
            else f"the document is a {type(value).__name__}, not fields with values"
        )
        raise SetupError(
            source,
            what,
            "begin with `format: rebar.decomposition/1`; docs/decompositions.md has a complete example",
        )
    return _checked(validate_document(value, DecompositionDocument, source, lines), vocabulary, source, lines)


def decomposition_of(
    document: DecompositionDocument, vocabulary: DecompositionVocabulary | None = None, source: str = ""
) -> Decomposition:
    """The graph of a document. Raises SetupError with every fault found in it."""
    return _checked(document, vocabulary, source, {})


def decomposition_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a decomposition file."""
    # pydantic does not write which dialect it follows; editors need it.
    schema = DecompositionDocument.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _checked(
    document: DecompositionDocument, vocabulary: DecompositionVocabulary | None, source: str, lines: Lines
) -> Decomposition:
    faults = DocumentChecks(document, vocabulary or DecompositionVocabulary(), source, lines).faults()
    if faults:
        raise SetupError(faults)
    return graph_of(document)
