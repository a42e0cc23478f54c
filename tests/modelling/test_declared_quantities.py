"""One property over the catalogue: every declared number of every part, friction law, controller and observer refuses what cannot be it, by its name.

What cannot be a quantity: nan, infinity, True, a complex number, a list, text without a unit, text with another unit, and a number out of its declared
bounds. What cannot be a whole number: all of these, a fraction and text. Quantities that need not be given are asked, too.
"""

from __future__ import annotations

import dataclasses
import inspect
import math

import pytest

import controllers
import models
from controllers import observers
from models import wells
from toolbox import Component, FrictionLaw, SceneError
from toolbox.authoring import check_fields
from toolbox.modelling.components import fields_of, is_nested


def examples():
    """{name: a part with its declared values}, of all kinds that can be made without arguments, and of all published sets."""
    found = {}
    for package in (models, controllers, observers):
        for name in package.__all__:
            kind = getattr(package, name)
            if inspect.isclass(kind) and dataclasses.is_dataclass(kind) and issubclass(kind, (Component, FrictionLaw)):
                needed = [f for f in dataclasses.fields(kind) if f.default is f.default_factory is dataclasses.MISSING]
                if not needed:
                    found[name] = kind()
    return found | {f"wells.{name}": part for name, part in vars(wells).items() if isinstance(part, Component)}


PARTS = examples()


def is_asked(field, declared):
    """Whether a field is a quantity that a single number, or the last number of a row, can make wrong, or a whole number."""
    a_row_without_numbers = field.tuples and not declared
    return field.kind == "int" or (
        field.numeric and "unit" in field.spec.metadata and not a_row_without_numbers and not is_nested(declared)
    )


FIELDS = [(name, field) for name, part in PARTS.items() for field in fields_of(type(part)) if is_asked(field, getattr(part, field.name))]


def outside(field):
    """Numbers out of the declared bounds of a field, and of its kind, if it has any."""
    bounds = field.spec.metadata
    for key, change in (("at_least", -1e-9), ("above", 0.0), ("at_most", 1e-9)):
        if bounds.get(key) is not None:
            yield bounds[key] + change * max(1.0, abs(bounds[key]))


@pytest.mark.parametrize(("name", "field"), FIELDS, ids=[f"{name}.{field.name}" for name, field in FIELDS])
def test_a_declared_number_refuses_by_its_name_what_it_cannot_be(name, field):
    part = PARTS[name]
    declared, unit = getattr(part, field.name), field.spec.metadata.get("unit", "1")
    check_fields(part)  # the twin: as declared it is accepted
    no_numbers = [math.nan, math.inf, -math.inf, True, 1j, [1.0]]
    texts = ["twelve", "12 cd", *(["12"] if unit != "1" else [])]  # nothing here is measured in candela
    for wrong in [*no_numbers, 1.5, "2"] if field.kind == "int" else [*no_numbers, *outside(field), *texts]:
        given = (*declared[:-1], wrong) if isinstance(declared, tuple) else wrong
        with pytest.raises(SceneError, match=rf"\b{field.name}\b"):
            check_fields(dataclasses.replace(part, **{field.name: given}))


def test_nearly_every_kind_of_the_catalogue_is_asked():
    assert len(PARTS) > 75 and len(FIELDS) > 560
