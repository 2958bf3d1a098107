"""Provenance of datasets: record of function, options and inputs of each stage, with hashes of their content.

.. include:: README.md
"""

from cablepod.provenance._abridged import Abridged, abridged
from cablepod.provenance._content import VariableContent, content_of, digest
from cablepod.provenance._inputs import CHANGED, MADE, NOT_COMPUTED, Input, input_of
from cablepod.provenance._record import defaulted_options, in_order, public_name, record, unrecorded
from cablepod.provenance._stages import checked_stages, is_history, merged_stages, stages_of
from cablepod.provenance._values import MAX_HISTORY_ITEMS, equidistant, to_json

__all__ = [
    "CHANGED", "MADE", "MAX_HISTORY_ITEMS", "NOT_COMPUTED", "Abridged", "Input",
    "VariableContent", "abridged", "checked_stages", "content_of", "defaulted_options", "digest",
    "equidistant", "in_order", "input_of", "is_history", "merged_stages", "public_name", "record", "stages_of",
    "to_json", "unrecorded",
]  # fmt: skip
