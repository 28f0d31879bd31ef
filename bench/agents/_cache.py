"""The folder that an agent's `prepare` command fills once, and every session of the agent reads."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import stat
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bench.contracts import AgentCache, AgentEndpoints, AgentManifest, AgentPlan, CacheNeed
from bench.documents import dump_json
from bench.errors import AgentBoxKilled, Fault, SetupError
from bench.removal import remove_tree
from bench.simspec import AgentSpec, Point, Polygon, SimSpec, World
from bench.temporary_folders import temporary_folder, user_cache
from bench.visible_text import visible

from ._manifest import load_manifest
from ._process import LocalProcess, open_agent
from ._program import expand_command, preparing
from .confinement import AGENT_UID, CONTAINER, agent_user, rung_of

_POLL_S = 0.05
# Between two looks at how large the folder is: walking it takes time.
_SIZE_POLL_S = 1.0
# Of what the command printed, in a fault.
_SHOWN_BYTES = 2000
_FOLDER, _NOTE = "cache", "filled.json"
# In a process of its own, because a process with threads can enter no network namespace.
_BOOT = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from bench.network_namespace import enter_network_namespace
enter_network_namespace()
from bench.agents._cache import print_faults
print_faults(sys.argv[2])
"""


@dataclass(frozen=True, slots=True)
class FilledCache:
    """A filled folder of this host, and what a result says of it."""

    folder: Path
    fact: AgentCache


@contextmanager
def open_cache(manifest: AgentManifest, folder: Path, agent: AgentSpec) -> Generator[FilledCache | None]:
    """The agent's cache, filled first where that has not been done; None for a manifest without one.

    It stays while the block runs. `folder` is the manifest's. Raises SetupError with what the command printed where it
    fails, takes too long or writes too much.
    """
    if manifest.cache is None:
        yield None
        return
    with ExitStack() as stack:
        try:
            place = _place(manifest, folder, agent)
            place.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(open(place.with_suffix(".lock"), "ab"))
            fact = _filled(manifest, folder, agent, place, lock.fileno())
        except OSError as error:
            remedy = "make room there, or set XDG_CACHE_HOME to another folder"
            raise SetupError(f"{manifest.name}: cache", f"cannot be kept: {error}", remedy) from error
        yield FilledCache(place / _FOLDER, fact)


def cache_faults(agent: AgentSpec) -> list[Fault]:
    """Fill an agent's cache, on a network of its own as its sessions have; why that cannot be done."""
    try:
        if load_manifest(agent.manifest)[0].cache is None:
            return []
    except SetupError:
        # The session itself tells what is wrong with the manifest.
        return []
    command = [sys.executable, "-P", "-c", _BOOT, json.dumps(sys.path), dump_json(agent)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, check=True)
    return [Fault(*fault) for fault in json.loads(done.stdout)]


def print_faults(agent_text: str) -> None:
    """The other end of `cache_faults`."""
    agent = AgentSpec.model_validate_json(agent_text)
    faults: tuple[Fault, ...] = ()
    try:
        with open_cache(*load_manifest(agent.manifest), agent):
            pass
    except SetupError as error:
        faults = tuple(error.faults)
    print(json.dumps([(fault.where, fault.what, fault.remedy) for fault in faults]))


def _filled(manifest: AgentManifest, folder: Path, agent: AgentSpec, place: Path, lock: int) -> AgentCache:
    note = place / _NOTE
    while True:
        # Sessions share it: what fills a newer cache removes this one only while none of them flies.
        fcntl.flock(lock, fcntl.LOCK_SH)
        if note.is_file():
            return AgentCache.model_validate_json(note.read_bytes())
        fcntl.flock(lock, fcntl.LOCK_EX)
        if note.is_file():
            continue
        _remove_older(place)
        remove_tree(place)
        _fill(manifest, folder, agent, place / _FOLDER)
        # Whole or not there, however this process ends.
        part = note.with_suffix(".part")
        part.write_text(dump_json(_content(manifest, place / _FOLDER)), encoding="utf-8")
        part.rename(note)


def _place(manifest: AgentManifest, folder: Path, agent: AgentSpec) -> Path:
    """Where a cache lies: elsewhere for another manifest, other options, another Python, and other files beside the manifest
    or named by its commands.
    """
    commands = (preparing(manifest), manifest)
    words = [word for kind in commands for word in expand_command(kind, folder, agent.options)]
    named = [Path(word) for word in words if word.startswith("/")]
    files = sorted({path for path in (*folder.iterdir(), *named) if path.is_file()})
    stats = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    state = [manifest.model_dump_json(exclude={"description"}), dict(agent.options), sys.version, stats]
    key, home = (
        hashlib.sha256(json.dumps(part, sort_keys=True).encode()).hexdigest()[:16]
        for part in (state, str(folder))
    )
    return user_cache() / "agents" / f"{manifest.name}-{home}" / key


def _remove_older(place: Path) -> None:
    """Remove the caches of earlier states of the agent that no session reads."""
    for path in place.parent.glob("*.lock"):
        if path == place.with_suffix(".lock"):
            continue
        # The locks stay: a process may have opened one and wait for it.
        with open(path, "rb") as lock, suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            remove_tree(path.with_suffix(""))


def _fill(manifest: AgentManifest, folder: Path, agent: AgentSpec, cache: Path) -> None:
    need = manifest.cache
    assert need is not None
    cache.mkdir(parents=True)
    if os.getuid() == 0:
        # As whom the command runs is the rung's to decide: a user of its own, or ours without its rights.
        is_image = rung_of(manifest, agent).name == CONTAINER
        os.chown(cache, AGENT_UID if is_image else agent_user(), os.getgid())
        cache.chmod(0o775)
    # A command that knows no session has options alone of it.
    area = Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (2, 0), (2, 2))))
    simspec = SimSpec(name="prepare", world=World(area=area), agent=agent)
    endpoints = AgentEndpoints({}, None, "", "", 0, None)
    with temporary_folder("prepare") as scratch:
        plan = AgentPlan(
            preparing(manifest), folder, simspec, endpoints, scratch, cache=cache, fills_cache=True
        )
        with open_agent(plan) as process:
            end = _end(process, need, cache)
    if end:
        printed = visible(process.output()[-_SHOWN_BYTES:].decode(errors="replace").strip()) or "nothing"
        what = f"{' '.join(need.prepare)!r} {end}; it printed last: {printed}"
        raise SetupError(f"{manifest.name}: cache", what, "correct it, or raise a limit in the manifest")


def _end(process: LocalProcess, need: CacheNeed, cache: Path) -> str:
    """Wait for the command; what is wrong with its end, empty for nothing."""
    began_s = looked_s = time.monotonic()
    code = None
    while code is None and time.monotonic() - began_s < need.budget_s:
        time.sleep(_POLL_S)
        try:
            code = process.exit_code()
        except AgentBoxKilled as error:
            return str(error)
        if code is not None or time.monotonic() - looked_s > _SIZE_POLL_S:
            if _size_bytes(cache) > need.size_mb << 20:
                return f"wrote more than {need.size_mb} MB"
            looked_s = time.monotonic()
    if code is None:
        return f"took longer than {need.budget_s:g} s"
    if limit := process.exceeded_limit():
        return f"took more than {limit}"
    return f"ended with exit code {code}" if code else ""


def _size_bytes(cache: Path) -> int:
    """What the files take on the disk, as far as they can be seen while they are written."""
    size = 0
    for folder, _, names in os.walk(cache):
        for name in names:
            with suppress(OSError):
                size += os.lstat(os.path.join(folder, name)).st_blocks * 512
    return size


def _content(manifest: AgentManifest, cache: Path) -> AgentCache:
    """What is in a filled cache, made readable for every user that a session's agent may be, and writable for none."""
    digest, count, size = hashlib.sha256(), 0, 0
    os.chown(cache, os.getuid(), os.getgid())
    cache.chmod(0o755)
    for folder, folders, files in os.walk(cache):
        folders.sort()
        for path in (Path(folder, name) for name in sorted((*folders, *files))):
            mode = path.lstat().st_mode
            os.chown(path, os.getuid(), os.getgid(), follow_symlinks=False)
            if stat.S_ISLNK(mode):
                content = os.readlink(path)
            elif stat.S_ISREG(mode) or stat.S_ISDIR(mode):
                runs = stat.S_ISDIR(mode) or mode & 0o111
                path.chmod(0o755 if runs else 0o644)
                content = str(bool(runs))
                if stat.S_ISREG(mode):
                    with open(path, "rb") as file:
                        content += hashlib.file_digest(file, "sha256").hexdigest()
                    count, size = count + 1, size + path.stat().st_size
            else:
                what = f"{path.relative_to(cache)} is neither a file nor a folder"
                raise SetupError(f"{manifest.name}: cache", what, "let the command that fills it remove it")
            line = (str(path.relative_to(cache)), stat.S_IFMT(mode), content)
            digest.update(json.dumps(line).encode())
    return AgentCache(sha256=digest.hexdigest(), files=count, size_bytes=size)
