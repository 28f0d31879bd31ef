"""Pausing a campaign from another terminal, and having its missing runs flown again: files in its folder, which the
runner looks for before each session.
"""

from __future__ import annotations

from pathlib import Path

from ._folder import existing_campaign, writing_process

PAUSE = ".paused"
RETRY = ".retry"


def pause_campaign(folder: Path) -> bool:
    """Let no further session of a campaign start; those that fly go on. False if it was paused already.

    Raises SetupError for a folder that is no campaign's.
    """
    existing_campaign(folder)
    already = is_paused(folder)
    (folder / PAUSE).touch()
    return not already


def resume_campaign(folder: Path) -> bool:
    """Let sessions start again. False if the campaign was not paused. Raises SetupError as `pause_campaign` does."""
    existing_campaign(folder)
    paused = is_paused(folder)
    (folder / PAUSE).unlink(missing_ok=True)
    return paused


def is_paused(folder: Path) -> bool:
    """Whether somebody has paused the campaign of a folder."""
    return (folder / PAUSE).exists()


def request_retry(folder: Path) -> str | None:
    """Ask the process that runs a campaign to fly its missing runs again, and return its id.

    None if no process runs it: nothing was asked then, since the next run flies them anyway. Raises SetupError as
    `pause_campaign` does.
    """
    existing_campaign(folder)
    process = writing_process(folder)
    if process is not None:
        (folder / RETRY).touch()
    return process


def take_retry_request(folder: Path) -> bool:
    """Whether somebody asked for the missing runs since the last call."""
    try:
        (folder / RETRY).unlink()
    except FileNotFoundError:
        return False
    return True
