"""What the sentence that is being read has spoken of, and what the sentences before it leave to it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from ..language._phrases import Phrase
from ..language._tokens import Span


@dataclass(slots=True)
class SentenceContext:
    """What has been said so far. `begin` forgets what belongs to one sentence; `last` and `before` stay."""

    topic: str = ""
    """What places and points are said of: group, home, ground, road; nothing at the beginning of a sentence."""
    last: str = ""
    """What was spoken of last, in this sentence or one before."""
    before: str = ""
    """What was spoken of before the group that is spoken of."""
    start: int = 0
    """Where the sentence begins."""
    joined: list[str] = field(default_factory=list)
    """The groups of a list that goes on: `two soldiers and a truck`."""
    waiting: list[Phrase] = field(default_factory=list)
    """Phrases that describe the next group."""
    company: list[str] = field(default_factory=list)
    """The groups before and after `with`: `four rescuers with two dogs`."""
    just_named: list[str] = field(default_factory=list)
    """The groups that a relation has named for the first time."""
    rule_groups: set[Span] = field(default_factory=set)
    """Groups that only go on a rule, and are not placed."""
    has_stranger: bool = False
    """Whether the sentence has spoken of something else, which may be its subject."""
    named_until: int = 0
    sized_until: int = 0
    """Where the sentence has last given the size of an area."""
    moved_until: int = 0
    anchored_until: int = 0

    def begin(self, start: int) -> None:
        """Begin the sentence at a place of the text."""
        begun = SentenceContext(last=self.last, before=self.before, start=start)
        for part in fields(self):
            setattr(self, part.name, getattr(begun, part.name))
