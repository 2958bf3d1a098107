"""Conventions of results: names, units and labels, and Datasets that have them.

Every public function labels its result with :func:`label`, so that attributes do not depend on their propagation through
arithmetic.  Units are UDUNITS strings, which pint reads too.  Texts (kinds, profiles, notes, failures) have the units "1",
which descriptions do not print.

| File | Content |
| --- | --- |
| `_vocabulary.py` | dimensions, their labels and orders, names, units and long names |
| `_datasets.py` | Datasets with units, long names and shared indexes |
| `_printed.py` | units for people: kN, m or mm, Hz in tables and figures |
"""

from cablepod.conventions._datasets import (
    MAX_TEMPLATE_LABELS,
    is_in_memory,
    label,
    labelled_dataset,
    plain_indexes,
    shared_coordinates,
)
from cablepod.conventions._printed import digits, direction, note_lines, printed, printed_unit, unit_text
from cablepod.conventions._vocabulary import (
    AIR_OF_EACH,
    ATTRIBUTES,
    COORDINATES,
    ENDINGS_OF_AIR,
    ENDS,
    FEATURES,
    INTERRUPTED,
    LABELS,
    ORDERED,
    OUTPUTS,
    STILL_AIR,
    UNITS,
    VARIABLES,
    attribute_labels,
    is_in_order,
    is_rising,
    names_in_air,
)

__all__ = [
    "AIR_OF_EACH",
    "ATTRIBUTES",
    "COORDINATES",
    "ENDINGS_OF_AIR",
    "ENDS",
    "FEATURES",
    "INTERRUPTED",
    "LABELS",
    "MAX_TEMPLATE_LABELS",
    "ORDERED",
    "OUTPUTS",
    "STILL_AIR",
    "UNITS",
    "VARIABLES",
    "attribute_labels",
    "digits",
    "direction",
    "is_in_memory",
    "is_in_order",
    "is_rising",
    "label",
    "labelled_dataset",
    "names_in_air",
    "note_lines",
    "plain_indexes",
    "printed",
    "printed_unit",
    "shared_coordinates",
    "unit_text",
]
