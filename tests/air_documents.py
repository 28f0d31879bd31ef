"""Documents of the air network that tests hold in their hands."""

from __future__ import annotations

from typing import TypeVar

from bench.contracts import document_text, parse_document
from bench.documents import Document

D = TypeVar("D")


def valid(kind: type[D], fields: object) -> D:
    """The document of these fields, or of a JSON text, which the bench takes."""
    document = parse_document(kind, fields if isinstance(fields, str | bytes) else document_text(fields))
    assert document is not None, fields
    return document


def text_of(document: object) -> str:
    """The JSON text of a document, of the air network or the truth."""
    return document.model_dump_json() if isinstance(document, Document) else document_text(document)
