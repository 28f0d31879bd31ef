"""Stands in for podman: takes the options that REBAR's containers use as the engine's CLI takes them, and runs the command
as an ordinary process. Refuses everything else, as the engine does, with its exit codes.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

STATE = Path(__file__).resolve().parent / "engine-state"
TAKES_VALUE = {
    *("--name", "--network", "--hostname", "--ipc", "--pull", "--entrypoint", "--cap-drop"),
    *("--security-opt", "--user", "--pids-limit", "--cpus", "--memory", "--memory-swap"),
    *("--shm-size", "--ulimit", "--tmpfs", "--workdir", "--log-driver", "--volume", "--device"),
    *("--env", "--stop-timeout", "--add-host"),
}
REQUIRED = {
    *("--read-only", "--read-only-tmpfs=false", "--ulimit=core=0:0", "--ulimit=fsize=268435456:268435456"),
    *("--cap-drop=ALL", "--security-opt=no-new-privileges", "--network=host", "--pull=never"),
    *("--user=60001:60001", "--ipc=private", "--memory=2048m", "--memory-swap=2048m"),
    *("--pids-limit=512", "--cpus=4"),
}
IMAGES = ("agents/one:1", "agents/two:2")


def fail(code: int, text: str) -> None:
    sys.exit(print(f"Error: {text}", file=sys.stderr) or code)


def state_file(name: str) -> Path:
    return STATE / f"{name}.json"


def save(name: str, **values: object) -> None:
    path = state_file(name)
    path.with_suffix(".part").write_text(json.dumps(values))
    path.with_suffix(".part").replace(path)


def run(words: list[str]) -> None:
    options: list[tuple[str, str]] = []
    while words and words[0].startswith("--"):
        option = words.pop(0)
        if option in ("--read-only", "--read-only-tmpfs=false"):
            options.append((option, ""))
        elif option in TAKES_VALUE:
            options.append((option, words.pop(0)))
        else:
            fail(125, f"unknown flag: {option}")
    stated = {option + (f"={value}" if value else "") for option, value in options}
    if missing := REQUIRED - stated:
        fail(125, f"not confined: {sorted(missing)}")
    profiles = [value.removeprefix("seccomp=") for option, value in options if value.startswith("seccomp=")]
    if len(profiles) != 1 or not json.loads(Path(profiles[0]).read_text())["syscalls"]:
        fail(125, "no profile of system calls")
    image, *command = words
    if image not in IMAGES:
        fail(125, f"{image}: image not known")
    # podman starts programs that this file names.
    if "CONTAINERS_CONF" in os.environ:
        fail(125, f"configured by {os.environ['CONTAINERS_CONF']}")
    values = dict(options)
    environment = {"PATH": os.defpath}
    for option, value in options:
        if option == "--env":
            key, given, text = value.partition("=")
            environment[key] = text if given else os.environ[key]
        if option == "--add-host":
            environment["HOSTS"] = f"{environment.get('HOSTS', '')}{value} "
        if option == "--volume" and not (Path(value.split(":")[0]).exists() and value.endswith(":ro")):
            fail(125, f"statfs {value}: no such file or directory")
    with tempfile.TemporaryDirectory() as scratch:
        environment["SCRATCH"] = scratch
        try:
            agent = subprocess.Popen(command, cwd=scratch, env=environment, start_new_session=True)
        except OSError as error:
            save(values["--name"], Pid=0, Status="created")
            fail(127, f"{command[0]}: {error.strerror}")
        save(values["--name"], Pid=agent.pid, Status="running")
        code = agent.wait()
        # The limit on memory is the engine's; a command that ends by SIGKILL stands for one that it killed.
        killed = code == -signal.SIGKILL and "OOM" in environment
        if state_file(values["--name"]).exists():
            save(values["--name"], Pid=0, Status="exited", OOMKilled=killed)
        sys.exit(128 - code if code < 0 else code)


def main() -> None:
    STATE.mkdir(exist_ok=True)
    verb, *words = sys.argv[1:]
    if verb == "version":
        print("5.0")
    elif verb == "run":
        run(words)
    elif verb == "inspect":
        print(state_file(words[-1]).read_text())
    elif verb == "ps":
        print("\n".join(path.stem for path in STATE.glob("*.json")))
    elif verb in ("kill", "rm"):
        path = state_file(words[-1])
        pid = json.loads(path.read_text())["Pid"] if path.exists() else 0
        if verb == "rm":
            path.unlink(missing_ok=True)
        if pid:
            os.killpg(pid, signal.SIGTERM if verb == "kill" else signal.SIGKILL)
    else:
        fail(125, f"unknown command {verb}")


if __name__ == "__main__":
    main()
