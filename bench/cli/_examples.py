"""The files that come with the distribution: campaigns, decompositions and examples."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from bench.errors import Fault, SetupError, command_line

FOLDERS = ("campaigns", "decompositions", "examples")
_SUFFIXES = (".yaml", ".py", ".toml", ".js", ".json", ".csv", ".md", ".txt")


def examples(
    copy: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Copy all files to this folder. Nothing is overwritten")
    ] = None,
) -> None:
    """List the campaigns, decompositions and examples that come with REBAR, or copy them to a folder of your own.

    Example: rebar examples --copy mine
    """
    files = sorted(shipped_files())
    if copy is None:
        print("\n".join(name for name, _ in files))
        print("\nrebar examples --copy DIR copies them, to be changed and run from there.")
        return
    occupied = [name for name, _ in files if os.path.lexists(copy / name)]
    if occupied:
        raise SetupError(
            [
                Fault(str(copy / name), "this file exists", "copy to another folder, or move this file away")
                for name in occupied
            ]
        )
    for name, source in files:
        target = copy / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    print(
        f"{len(files)} files in {copy}. Try: {command_line('rebar', 'run', copy / 'campaigns' / 'demo.yaml')}"
    )


def shipped(name: str) -> Path:
    """The path of a shipped file, named from the top of the project such as `campaigns/demo.yaml`."""
    top, _, rest = name.partition("/")
    return _folder(top) / rest


def shipped_files() -> Iterator[tuple[str, Path]]:
    """Every shipped file with its name from the top of the project."""
    for top in FOLDERS:
        folder = _folder(top)
        for path in folder.rglob("*"):
            # What npm installs beside an example is not shipped, and has more files than everything else.
            if "node_modules" not in path.parts and path.is_file() and path.suffix in _SUFFIXES:
                yield f"{top}/{path.relative_to(folder).as_posix()}", path


def _folder(top: str) -> Path:
    """Where a folder of shipped files lies: in the package if installed, at the top of a checkout otherwise."""
    if top == "decompositions":
        import decompositions

        return Path(decompositions.__file__).parent / "data"
    packaged = Path(__file__).with_name("shipped") / top
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / top
