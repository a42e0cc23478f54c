"""The panels of `stickslip onset`: one for each law, on common axes."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")


from models import BlockOnBelt, Exponential
from toolbox import compose, onset
from toolbox.onsets.figures import onset_panels


def test_every_panel_has_its_name_above_and_one_legend_holds_what_is_in_any_of_them():
    law = Exponential(static=1.0, kinetic=0.5, decay=2.0)
    found = {  # the first block loses smooth running in the range, the second does not
        name: onset(compose(BlockOnBelt(damping=damping, friction=law)), "block.belt_speed", (0.1, 1.0), num_values=3)
        for name, damping in (("little damping", 0.7), ("much damping", 2.0))
    }
    for order in (list(found), list(found)[::-1]):
        panels = onset_panels({name: found[name] for name in order})
        assert [ax.get_title(loc="left") for ax in panels] == order
        assert all(ax.get_legend() is None and not ax.texts for ax in panels)
        (legend,) = panels[0].figure.legends
        words = [text.get_text() for text in legend.get_texts()]
        assert "Hopf point" in words and len(words) == len(set(words))
