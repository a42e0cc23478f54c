"""What a scene needs for what it measures."""

import dataclasses
from pathlib import Path

import pytest

from models import BitRock, BlockOnBelt, TorsionalChain
from tests.refusals import each_of, refusals
from toolbox import Scene, Update, compose, simulate, state
from toolbox.modelling.dependencies import dependencies_of
from toolbox.modelling.laws import Controller

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def test_every_part_of_a_shipped_drill_string_is_needed():
    found = Scene.load(SCENES / "jansen_2.toml").dependencies()
    assert all("severity" in need.metrics for need in found.parts)
    assert found.warning == ""
    assert found.idle == 0.0


def test_a_part_that_no_measure_looks_at_is_named_with_its_cost_and_leaving_it_out_changes_nothing():
    rig = Scene.load(SCENES / "jansen_2.toml")
    scene = dataclasses.replace(rig, parts=(*rig.parts, BlockOnBelt()))
    found = scene.dependencies()
    (idle,) = found.unused
    assert (idle.part, idle.states, idle.elements) == ("BlockOnBelt", 2, 1)
    assert 0.1 < found.idle < 0.6
    assert "BlockOnBelt (2 states, 1 elements)" in str(found)
    arguments = {"inputs": {"top.torque": 6000.0}, "accuracy": 1e-9}
    alone, beside = (simulate(compose(*parts), 20.0, **arguments) for parts in (rig.parts, scene.parts))
    assert beside.at(20.0)["bit.speed"] == pytest.approx(alone.at(20.0)["bit.speed"], abs=1e-7)
    assert not scene.dependencies({"belt": ("block.position",), "bit": ("bit",)}).unused


def test_what_a_measure_depends_on_is_followed_through_forces_modes_and_sampled_laws():
    chain = TorsionalChain(inertia=(2000.0, 300.0), stiffness=(500.0,), damping=(20.0,))
    system = compose(chain, BitRock(), BlockOnBelt())
    found = dependencies_of(system, {"top": ("top.speed",), "belt": ("belt.force",)})
    (first, rock, belt) = found.parts
    assert [line.split()[-1] for line in str(found).splitlines()] == ["top", "top", "belt"]
    assert str(dependencies_of(system, {"top": ("top.speed",)})).splitlines()[2].endswith("no measure depends on it")
    assert first.metrics == rock.metrics == ("top",)
    assert belt.metrics == ("belt",)

    @dataclasses.dataclass(frozen=True)
    class Echo(Controller):
        measured_signals, actuated_signals = ("block.speed",), ("top.torque",)

        def sampled(self, signal, period):
            last = state("echo.last", "m/s")
            return Update({last: signal("block.speed", "m/s")}, {"top.torque": (1000.0 * last, "N m")})

    from toolbox.modelling.laws import ZeroOrderHold

    looped = compose(chain, BitRock(), BlockOnBelt(), ZeroOrderHold(Echo()))
    assert "top" in dependencies_of(looped, {"top": ("top.speed",)}).parts[2].metrics


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: Scene.load(SCENES / "jansen_2.toml").dependencies({"severity": ("bit.sped",)}), "bit.sped"),
    *each_of(lambda metrics: dependencies_of(compose(TorsionalChain(), BitRock(weight=5e4)), metrics), "Argument `metrics` must map",
     [["bit.speed"], {"severity": "bit.speed"}]),
)  # fmt: skip
