"""From a description in words to a base SimSpec, with ranges, choices, and a receipt for every field.

from bench.instance_analysis import load_vocabulary, read_prose
result = read_prose("A radar vehicle. Between 5 and 10 civilians within 50 m of it, light rain.", load_vocabulary())
print(result.simspec, result.ranges, result.choices)
"""

from __future__ import annotations

from ._annotated import annotated_yaml as annotated_yaml
from ._annotated import stated_values as stated_values
from ._page import page as page
from ._prose import MAX_CHARACTERS as MAX_CHARACTERS
from ._prose import read_prose as read_prose
from ._result import BaseSimSpec as BaseSimSpec
from ._result import Choice as Choice
from ._result import ClauseReading as ClauseReading
from ._result import Receipt as Receipt
from ._result import UnreadText as UnreadText
from ._result import VariedField as VariedField
from ._rewritten import rewrite_prose as rewrite_prose
from .language._vocabulary import Vocabulary as Vocabulary
from .language._vocabulary import VocabularyDocument as VocabularyDocument
from .language._vocabulary import load_vocabulary as load_vocabulary
from .rewriting._endpoint import ModelEndpoint as ModelEndpoint
from .rewriting._model import RewrittenResult as RewrittenResult
from .rewriting._rewrite import Rewrite as Rewrite
