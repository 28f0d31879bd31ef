"""Finding an agent's manifest: by name among the entry points, or by the path of a YAML file."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path

from bench.contracts import AgentManifest, AgentRole, load_plugin, plugins
from bench.documents import load_document
from bench.errors import SetupError
from bench.simspec import agent_name, is_manifest_file


def load_manifest(name_or_path: str | Path) -> tuple[AgentManifest, Path]:
    """The manifest and the folder that `{folder}` stands for.

    A file (`is_manifest_file`) is looked up from the present folder; any other value is a name in the entry-point group
    `rebar.agents`, whose value is the path of a manifest or a function without arguments that returns it. The manifest's
    `name` is replaced by `agent_name`, so that messages name the agent as results do. Raises SetupError with every fault.
    """
    text = str(name_or_path)
    path = Path.cwd() / (Path(text) if is_manifest_file(text) else _path_of_plugin(text))
    manifest = load_document(path, AgentManifest)
    return manifest.model_copy(update={"name": agent_name(text)}), path.resolve().parent


@cache
def installed_agents(role: AgentRole) -> tuple[str, ...]:
    """Names of the installed agents with this role in their manifest, in alphabetical order.

    A manifest that cannot be read has none: whoever names its agent is told why.
    """
    names = []
    for name in sorted(plugins("rebar.agents")):
        with suppress(SetupError):
            if load_manifest(name)[0].role == role:
                names.append(name)
    return tuple(names)


def _path_of_plugin(name: str) -> Path:
    provider = load_plugin("rebar.agents", name)
    path = provider() if callable(provider) else provider
    if not isinstance(path, str | Path):
        raise SetupError(
            f"rebar.agents: {name}",
            f"gives {type(path).__name__}, not the path of a manifest",
            "return a pathlib.Path",
        )
    return Path(path)
