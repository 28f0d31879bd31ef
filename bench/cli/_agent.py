"""`rebar agent new`: a folder with an agent that flies at once, and a campaign for it."""

from __future__ import annotations

import os
import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bench.errors import Fault, SetupError, command_line

from ._examples import shipped


class Language(StrEnum):
    """What a new agent is written in. Each needs nothing but the language itself."""

    PYTHON = "python"
    NODE = "node"


# The manifest, the program and the client of examples/tick.
_FILES = {
    Language.PYTHON: ("search.yaml", "search.py", "rebar_air.py"),
    Language.NODE: ("search-node.yaml", "search.js", "rebar_air.js"),
}
_CAMPAIGN = """\
# Two scenes, in clear air and in fog, each flown by your agent and by a reference agent.
format: rebar.campaign/1
name: {name}
decomposition: search-and-report
study: [KA-03, KA-05, KA-09, KA-18, KA-20]
agents:
  - manifest: {name}.yaml
  - manifest: reference-bystander-aware
base_file: scene.yaml
design:
  seed: 1
  replicates: 1
  method: {{kind: full_factorial}}
  factors:
    - name: fog
      unit: level
      levels: [1.0, 4.0]
      sets: [environment.fog_level]
"""
_README = """\
# {name}

- `rebar simulate scene.yaml --out out/scene` flies one session and says what was not achieved.
- `rebar run campaign.yaml --out out/campaign` flies the campaign and writes out/campaign/report.html.
- `{program}` is the agent: it searches, reports, publishes tracks and lands. Change it.
- `{client}` is its client: the bench's ticks and messages, MAVLink, pixels to ground.
- `{name}.yaml` is what the bench reads: command, pace, limits (`rebar schema agent`).
- The messages: `rebar schema --keys scene.yaml`, and `rebar schema target-report` for one of them.
"""

agent = typer.Typer(
    name="agent", help="Begin an agent.", no_args_is_help=True, pretty_exceptions_enable=False
)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(agent)


@agent.callback()
def options() -> None:
    """Begin an agent."""


@agent.command()
def new(
    folder: Annotated[
        Path, typer.Argument(help="The folder to make; its name becomes the agent's", show_default=False)
    ],
    language: Annotated[Language, typer.Option(help="What the agent is written in")] = Language.PYTHON,
) -> None:
    """Make a folder with an agent that flies at once, a scene, and a campaign of two scenes. It speaks to PX4, in lockstep.

    Example: rebar agent new scout --language node
    """
    name = folder.resolve().name
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]{0,63}", name):
        raise SetupError(
            Fault(
                str(folder), "its name is no agent's", "use lower-case letters, digits and hyphens: scout-2"
            )
        )
    if os.path.lexists(folder):
        raise SetupError(Fault(str(folder), "this path exists", "give a folder that is to be made"))
    manifest, program, client = _FILES[language]
    texts = {file: shipped(f"examples/tick/{file}").read_text(encoding="utf-8") for file in (program, client)}
    text = shipped(f"examples/tick/{manifest}").read_text(encoding="utf-8")
    text = re.sub(r"^name: .*$", f"name: {name}", text, flags=re.MULTILINE)
    # Results name an agent by its manifest's file.
    texts[f"{name}.yaml"] = re.sub(r"^description: .*\n", "", text, flags=re.MULTILINE)
    scene = shipped("examples/search.yaml").read_text(encoding="utf-8")
    texts["scene.yaml"] = re.sub(
        r"^agent: .*$", f"agent: {{manifest: {name}.yaml}}", scene, flags=re.MULTILINE
    ).replace("rebar simulate examples/search.yaml", "rebar simulate scene.yaml")
    texts["campaign.yaml"] = _CAMPAIGN.format(name=name)
    texts["README.md"] = _README.format(name=name, program=program, client=client)
    folder.mkdir(parents=True)
    for file, content in texts.items():
        (folder / file).write_text(content, encoding="utf-8")
    print(f"{len(texts)} files in {folder}. Try: {command_line('rebar', 'simulate', folder / 'scene.yaml')}")
