"""The page: a few lines around the built script, and one run as a file that can be mailed."""

from __future__ import annotations

import hashlib
import html
from base64 import b64encode
from importlib.resources import files

from ._content import Content, document_text

_HEAD = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
)


ICON = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><path d="M8 1l5 14-5-3-5 3z" fill="#0b5c8a"/></svg>'


def script() -> str:
    """The script that `make view` has built."""
    return (files("bench.view") / "static" / "app.js").read_text(encoding="utf-8")


def index_page(title: str) -> str:
    """The page of the server; its script and its data come from there."""
    icon = '<link rel="icon" href="/icon.svg">'
    return f'{_HEAD}<title>{html.escape(title)}</title>{icon}<body><script type="module" src="/app.js"></script></body></html>'


def run_page(content: Content, name: str) -> str:
    """One run in one file: script, recording and result. It loads nothing, and no other script may run in it."""
    document = document_text({"name": name, "run": content.run(name)})
    data, recording = (
        b64encode(part).decode() for part in (document.encode(), content.recording(name).read_bytes())
    )
    # What ends a script in HTML is no part of base64, and is spelled otherwise here.
    code = script().replace("</", "<\\/")
    digest = b64encode(hashlib.sha256(code.encode()).digest()).decode()
    policy = f"default-src 'none'; script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    return (
        f'{_HEAD}<meta http-equiv="Content-Security-Policy" content="{policy}"><title>{html.escape(name)}</title><body>'
        f'<script type="text/plain" id="run-data">{data}</script>'
        f'<script type="text/plain" id="run-recording">{recording}</script>'
        f'<script type="module">{code}</script></body></html>'
    )
