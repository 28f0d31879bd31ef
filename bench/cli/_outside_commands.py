"""Commands of installed packages: functions as typer reads them, in the entry-point group rebar.commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import typer
from typer.core import TyperGroup

from bench.errors import SetupError
from bench.plugins import EXAMPLES, load_plugin, package_of, plugins


class OutsideCommands(TyperGroup):
    """The bench's commands and, after them, those of packages, each imported when it is called or listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*self.commands, *sorted(self._outside())]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        # The bench's own first: a call of one does not search what is installed.
        if cmd_name in self.commands:
            return self.commands[cmd_name]
        if cmd_name not in self._outside():
            if example := EXAMPLES.get(("rebar.commands", cmd_name)):
                what = "is a command of a package that is not installed"
                raise SetupError(cmd_name, what, f"pip install {example}")
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name)(load_plugin("rebar.commands", cmd_name))
        return typer.main.get_command(alone)

    def _outside(self) -> Mapping[str, object]:
        found = plugins("rebar.commands")
        for name in sorted(found.keys() & self.commands.keys()):
            what = f"{name!r} of {package_of('rebar.commands', name)} is a command of the bench"
            raise SetupError("rebar.commands", what, "rename it in the package, or uninstall that")
        return found
