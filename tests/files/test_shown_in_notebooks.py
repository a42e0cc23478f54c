"""What a notebook shows of values: what they print, or a table of their fields, with no character read as HTML."""

import dataclasses

import pytest

from controllers import SoftTorque
from models import BitRock, wells
from toolbox import Scene, closed_loop, compose, equilibrium, margins, measure, simulate
from toolbox.files.printing import Printed

LOOP = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="90 rpm"))


@pytest.mark.parametrize(
    "make",
    [
        lambda: LOOP,
        lambda: equilibrium(LOOP),
        lambda: margins(LOOP),
        lambda: measure.energy_audit(simulate(LOOP, 1.0)),
        lambda: Scene.of(LOOP.plant, 10.0, {"a < b": LOOP.laws[0]}, title="<script>"),
    ],
    ids=["loop", "steady state", "margins", "audit", "scene"],
)
def test_a_value_is_shown_as_it_prints(make):
    value = make()
    shown, (title, *rest) = value._repr_html_(), str(value).splitlines()
    text = shown.replace("&lt;", "<").replace("&gt;", ">").replace("&#x27;", "'").replace("&quot;", '"').replace("&amp;", "&")
    assert f"<b>{title}</b>" in text and "\n".join(rest) in text and "<script>" not in shown


def test_parts_and_laws_are_shown_as_tables_of_their_fields():
    shown = BitRock(weight="97 kN")._repr_html_()
    assert ">weight</td>" in shown and ">97000</td>" in shown and "weight on bit" in shown
    law = SoftTorque(reference="90 rpm")
    given = [each.name for each in dataclasses.fields(law) if getattr(law, each.name) is not None]
    assert all(f">{name}</td>" in law._repr_html_() for name in given) and ">9.42478</td>" in law._repr_html_()
    assert "<td" in BitRock().friction._repr_html_()


def test_what_prints_one_line_has_no_empty_block():
    class Line(Printed):
        def __str__(self):
            return "1 < 2"

    assert Line()._repr_html_() == "<div><p><b>1 &lt; 2</b></p></div>"
