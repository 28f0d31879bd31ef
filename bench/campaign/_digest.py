"""The digest of what a campaign asks: equal for all who fly the same benchmark, whichever agents they fly."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from ._document import Campaign

# Whose agents fly, within which time of the host, and what the campaign is called changes no scene, nor does where it is flown; a honeypot changes
# nothing that is seen or measured.
NOT_ASKED = {"name", "description", "agents", "floor", "budgets", "honeypots", "keep", "shard"}
SITUATIONS = {"base", "situations"}


def question_sha256(campaign: Campaign) -> str:
    """SHA-256, in hexadecimal, over situations in full, design, decomposition, study and stopping.

    The same for a campaign file and for the `campaign.yaml` of a folder that was flown from it.
    """
    # Situations in full: a changed default of a SimSpec changes what is flown. Of the rest only what is stated, so
    # that a new option of campaigns leaves the digests of those without it alone.
    question: dict[str, Any] = campaign.model_dump(mode="json", include=SITUATIONS)
    question |= campaign.model_dump(mode="json", exclude=NOT_ASKED | SITUATIONS, exclude_defaults=True)
    return hashlib.sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()
