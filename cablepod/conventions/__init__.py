"""Conventions of results: names, units and labels, and Datasets that have them.

Every public function labels its result with :func:`label`, so that attributes do not depend on their propagation through
arithmetic.  Units are UDUNITS strings, which pint reads too.

| File | Content |
| --- | --- |
| `_vocabulary.py` | dimensions and their labels, names, units and long names |
| `_orders.py` | orders of labels, instants and places |
| `_datasets.py` | Datasets with units, long names and shared indexes |
"""

from cablepod.conventions._datasets import (
    MAX_TEMPLATE_LABELS,
    label,
    labelled_dataset,
    shared_coordinates,
    values_of_index,
)
from cablepod.conventions._orders import (
    IN_ORDER,
    PLACES_IN_ORDER,
    is_in_order,
    is_rising,
    keep_places,
    note_in_order,
    note_places,
)
from cablepod.conventions._vocabulary import (
    AIR_OF_EACH,
    ATTRIBUTES,
    COORDINATES,
    ENDINGS_OF_AIR,
    ENDS,
    FEATURES,
    INTERRUPTED,
    LABELS,
    OUTPUTS,
    STILL_AIR,
    UNITS,
    VARIABLES,
    attribute_labels,
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
    "IN_ORDER",
    "LABELS",
    "MAX_TEMPLATE_LABELS",
    "OUTPUTS",
    "PLACES_IN_ORDER",
    "STILL_AIR",
    "UNITS",
    "VARIABLES",
    "attribute_labels",
    "is_in_order",
    "is_rising",
    "keep_places",
    "label",
    "labelled_dataset",
    "names_in_air",
    "note_in_order",
    "note_places",
    "shared_coordinates",
    "values_of_index",
]
