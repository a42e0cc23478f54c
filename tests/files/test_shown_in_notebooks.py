"""What a notebook shows of values: what they print, or a table of their fields, with no character read as HTML."""

import dataclasses
import re

import pytest

from controllers import SoftTorque
from models import BitRock, wells
from toolbox import Scene, closed_loop, compose, equilibrium, margins, measure, simulate
from toolbox.files.printing import Printed, Rows, Told

LOOP = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="90 rpm"))


@pytest.mark.parametrize(
    "make",
    [
        lambda: LOOP,
        lambda: equilibrium(LOOP),
        lambda: measure.energy_audit(simulate(LOOP, 1.0)),
        lambda: Scene.of(LOOP.plant, 10.0, {"a < b": LOOP.controllers[0]}, title="<script>"),
    ],
    ids=["loop", "steady state", "audit", "scene"],
)
def test_a_value_is_shown_as_it_prints(make):
    value = make()
    shown, (title, *rest) = value._repr_html_(), str(value).splitlines()
    text = shown.replace("&lt;", "<").replace("&gt;", ">").replace("&#x27;", "'").replace("&quot;", '"').replace("&amp;", "&")
    assert f"<b>{title}</b>" in text and "\n".join(rest) in text and "<script>" not in shown


def test_what_says_itself_in_sentences_and_tables_says_the_same_printed_and_in_a_notebook():
    found = margins(LOOP)
    title, *rows = str(found).splitlines()
    shown = found._repr_html_()
    assert f"<b>{title}</b>" in shown
    printed = [cell for row in rows for cell in re.split(r" {2,}", row.strip())]
    assert len(printed) > 10 and re.findall(r"<t[hd][^>]*>([^<]+)</t[hd]>", shown) == printed

    class Said(Told):
        def _told(self):
            return ["a < b", "  a sentence on `one`", Rows([("head", "unit"), ("<script>", "1")])]

    assert str(Said()) == "a < b\n  a sentence on `one`\n  head      unit\n  <script>     1"
    assert "<script>" not in Said()._repr_html_() and "<p>a sentence on <code>one</code></p>" in Said()._repr_html_()


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
