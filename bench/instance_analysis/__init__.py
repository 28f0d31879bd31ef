"""From a description in words to a base SimSpec, with ranges and a receipt for every field.

from bench.instance_analysis import load_vocabulary, read_prose
found = read_prose("A radar vehicle. Between 5 and 10 civilians within 50 m of it, light rain.", load_vocabulary())
print(found.simspec, found.ranges, found.questions)
"""

from __future__ import annotations

from ._annotated import annotated_yaml as annotated_yaml
from ._annotated import said_of as said_of
from ._draft import BaseSimSpec as BaseSimSpec
from ._draft import Question as Question
from ._draft import Receipt as Receipt
from ._draft import Unread as Unread
from ._draft import Varied as Varied
from ._model import ModelEndpoint as ModelEndpoint
from ._proposal import Proposed as Proposed
from ._proposal import propose as propose
from ._prose import MAX_CHARACTERS as MAX_CHARACTERS
from ._prose import read_prose as read_prose
from ._vocabulary import Vocabulary as Vocabulary
from ._vocabulary import VocabularyDocument as VocabularyDocument
from ._vocabulary import load_vocabulary as load_vocabulary
