"""Documents that people write or read: closed pydantic models, and files of them with all their faults.

The floor of the house together with `bench.errors`: they import nothing of ours but `bench.values` and
`bench.visible_text`, and every room may stand on them.

campaign = load_document("campaigns/demo.yaml", Campaign)
"""

from __future__ import annotations

from ._document import Document as Document
from ._document import added_field as added_field
from ._document import dump_json as dump_json
from ._document import dump_yaml as dump_yaml
from ._document import is_default as is_default
from ._document import load_document as load_document
from ._document import load_json_document as load_json_document
from ._document import read_document as read_document
from ._document import read_json_document as read_json_document
from ._document import validate_document as validate_document
from ._files import MAX_BYTES as MAX_BYTES
from ._files import open_file as open_file
from ._files import read_bytes as read_bytes
from ._files import read_text as read_text
from ._plain_values import decimal_number as decimal_number
from ._plain_values import dump_value as dump_value
from ._plain_values import parse_text as parse_text
