"""Pausing a campaign from another terminal: a file in its folder, which the runner looks for before each session."""

from __future__ import annotations

from pathlib import Path

from bench.errors import Fault, SetupError

from ._folder import CampaignFolder

PAUSE = ".paused"


def pause_campaign(folder: Path) -> bool:
    """Let no further session of a campaign start; those that fly go on. False if it was paused already.

    Raises SetupError for a folder that is no campaign's.
    """
    _check(folder)
    already = is_paused(folder)
    (folder / PAUSE).touch()
    return not already


def resume_campaign(folder: Path) -> bool:
    """Let sessions start again. False if the campaign was not paused. Raises SetupError as `pause_campaign` does."""
    _check(folder)
    paused = is_paused(folder)
    (folder / PAUSE).unlink(missing_ok=True)
    return paused


def is_paused(folder: Path) -> bool:
    """Whether somebody has paused the campaign of a folder."""
    return (folder / PAUSE).exists()


def _check(folder: Path) -> None:
    if not CampaignFolder(folder).journal.is_file():
        raise SetupError(
            Fault(
                str(folder), "is not the folder of a campaign", "name the folder that `rebar run --out` wrote"
            )
        )
