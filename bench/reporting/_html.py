"""What every page of the report's making shares: it fetches nothing, runs its own scripts alone, and takes all text as text."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.resources import files

import jinja2
from markupsafe import Markup


def policy(*scripts: str) -> str:
    """Content security policy: nothing is fetched, and only these scripts run, by their digests."""
    digests = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in scripts)
    return f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def script_text(text: str) -> str:
    """As the browser will see it, so that its digest is the policy's: line ends are normalised while parsing."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def data_text(value: object) -> Markup:
    """JSON for a script element; only `<` can end or open anything there, and as an escape it means the same to JSON."""
    return Markup(json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def template_text(name: str) -> str:
    """A file that goes into a page as it is."""
    return (files("bench.reporting") / "templates" / name).read_text(encoding="utf-8")


def environment() -> jinja2.Environment:
    """Templates, with everything escaped that is not explicitly markup: what agents and documents say is text."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("bench.reporting", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
