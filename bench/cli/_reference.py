"""`rebar measures` and `rebar tables`: reference that the plug-ins give about themselves."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Annotated

import typer

from bench.errors import SetupError

from ._tables import add_plain_row, plain_console, plain_table, wrapped


def measures(
    name: Annotated[
        str, typer.Argument(help="A measure, or a module of measures such as orders, to explain")
    ] = "",
) -> None:
    """List the measures that a decomposition can name; or explain a measure, or all of a module, with the options.

    Example: rebar measures

    Example: rebar measures order_obeyed

    Example: rebar measures orders
    """
    from bench.contracts import load_plugin, plugins

    modules = {measure: entry.module for measure, entry in plugins("rebar.measures").items()}
    chosen = [
        measure
        for measure, module in modules.items()
        if not name or name in (measure, module, *module.split("."))
    ]
    if not chosen:
        raise SetupError(name, "is neither a measure nor a module of measures", "`rebar measures` lists all")
    width = plain_console().width
    for module, members in groupby(sorted(chosen, key=lambda measure: modules[measure]), modules.__getitem__):
        print(f"{module}\n")
        loaded = {measure: load_plugin("rebar.measures", measure) for measure in members}
        if name:
            # A callable of another package may have neither.
            conventions = dict.fromkeys(getattr(measure, "conventions", "") for measure in loaded.values())
            print("".join(f"{_paragraphs(text, width)}\n\n" for text in conventions if text), end="")
        for measure, plugin in loaded.items():
            explanation = getattr(plugin, "explanation", None) or inspect.getdoc(plugin) or "not explained"
            if name:
                print(_paragraphs(f"{measure}: {explanation}", width) + "\n")
            else:
                summary = explanation.partition("\n\n")[0]
                print(wrapped(f"{measure}: {' '.join(summary.split())}", width, 2))
        print()


def _paragraphs(text: str, width: int) -> str:
    """Paragraphs and lists of a docstring at the width of the terminal."""
    paragraphs = []
    for paragraph in text.strip().split("\n\n"):
        # An item of a list begins with a dash; all other lines go on.
        items = ("\n" + paragraph).replace("\n- ", "\n\n- ").strip().split("\n\n")
        paragraphs.append(
            "\n".join(wrapped(" ".join(item.split()), width, 2 * item.startswith("- ")) for item in items)
        )
    return "\n\n".join(paragraphs)


def tables(
    table: Annotated[str, typer.Argument(help="Name of the table")] = "",
    words: Annotated[
        list[str] | None, typer.Argument(help="Print only the rows with all these words")
    ] = None,
) -> None:
    """List the tables of the imitated autopilots, or print one: parameters, commands, what differs from the real ones.

    Example: rebar tables

    Example: rebar tables parameters ardupilot RTL

    Example: rebar tables conformance px4 different
    """
    from bench.contracts import load_plugin, plugins

    console = plain_console()
    if not table:
        for name in sorted(plugins("rebar.tables")):
            summary = (load_plugin("rebar.tables", name).__doc__ or "").partition("\n\n")[0]
            print(wrapped(f"{name}: {' '.join(summary.split())}", console.width, 2))
        return
    rows: Callable[[], Sequence[tuple[str, ...]]] = load_plugin("rebar.tables", table)
    header, *rest = rows()
    kept = [row for row in rest if all(word.casefold() in " ".join(row).casefold() for word in words or ())]
    printed = plain_table(header, texts=header)
    for row in kept:
        add_plain_row(printed, row)
    console.print(printed)
    print(f"{len(kept)} of {len(rest)} rows")
