"""The read-only files that a client may fetch: contents by path, made when first asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

Content = Callable[[str], bytes]
"""Gives a file's bytes; its argument is what stood behind a question mark in the path."""


class Files:
    """Paths are relative to the root, with or without a slash before them; folders are what paths imply."""

    def __init__(self, contents: Mapping[str, Content]) -> None:
        self._contents = dict(contents)

    def read(self, path: str) -> bytes | None:
        """A file's bytes, or None when there is none."""
        name, _, query = _plain(path).partition("?")
        content = self._contents.get(name)
        return content(query) if content else None

    def entries(self, path: str) -> list[str] | None:
        """What a folder holds, as the protocol writes it (F name, tab, size; D name), in order; None for no folder."""
        folder = _plain(path)
        prefix = f"{folder}/" if folder else ""
        found: dict[str, str] = {}
        for name, content in self._contents.items():
            if not name.startswith(prefix):
                continue
            head, slash, _ = name[len(prefix) :].partition("/")
            found[head] = f"D{head}" if slash else f"F{head}\t{len(content(''))}"
        return [found[head] for head in sorted(found)] if found or not folder else None


def _plain(path: str) -> str:
    return path.strip().removeprefix("./").strip("/") if path.strip() != "." else ""
