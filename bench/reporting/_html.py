"""What the HTML pages share: they fetch nothing, run only their own scripts, and escape all text."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.resources import files

import jinja2
from markupsafe import Markup

from bench.visible_text import visible_values


def content_security_policy(*scripts: str) -> str:
    """A content security policy: nothing is fetched, and only these scripts run, identified by their digests."""
    digests = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in scripts
    )
    return f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def normalized_script(text: str) -> str:
    """The script with normalized line ends."""
    # Browsers normalize line ends while parsing, and the digest in the policy must match what they see.
    return text.replace("\r\n", "\n").replace("\r", "\n")


def json_script_text(value: object) -> Markup:
    """JSON text that is safe inside a script element."""
    # Only `<` can open or close an element there. Written as an escape, it means the same in JSON.
    text = json.dumps(visible_values(value), separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def template_text(name: str) -> str:
    """The text of a template file that goes into a page unchanged."""
    return (files("bench.reporting") / "templates" / name).read_text(encoding="utf-8")


def template_environment() -> jinja2.Environment:
    """The template environment.

    It escapes everything that is not explicitly markup, and shows what would not be seen, because agents write some of the
    texts.
    """
    return jinja2.Environment(
        loader=jinja2.PackageLoader("bench.reporting", "templates"),
        finalize=lambda value: value if isinstance(value, Markup) else visible_values(value),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
