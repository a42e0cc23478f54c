"""One word for one thing: the public interface has none of its former names, and refuses each with the name now."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import controllers
import models
import toolbox
import toolbox.files.printing
import toolbox.files.tables
from controllers import PI, Lifting
from models import BlockOnBelt
from toolbox import Sampled, SceneError, compose, sweep
from toolbox.commands.command_line import COMMANDS, main
from toolbox.drilling.lowest_set_point import LowestSetPoints, SetPointLimit
from toolbox.files.results import Result
from toolbox.former_names import ENTRIES
from toolbox.scenes.scene import Scene
from toolbox.vocabulary import NOW

FACES = (
    "toolbox",
    "models",
    "controllers",
    "controllers.observers",
    *(f"toolbox.{m.name}" for m in pkgutil.iter_modules(toolbox.__path__) if m.ispkg),
)

NOWHERE = {
    "asked", "told", "say", "late", "between", "vary", "box", "journal", "known", "mute", "strays", "bearable", "truths", "usual", "lasts", "ways",
    "measures", "drives", "laws", "torque_walk", "drive_walk", "strength_walk", "hole", "disagreement",
}  # fmt: skip
"""Former names that no public function has as an argument, and no public class as a field, whatever it would mean there."""

EXCEPTIONS = {("Recording", "between"), ("predict", "known"), ("Compiled", "known"), ("suggest", "known")}
"""The part of a recording between two times, and what is known of its numbers, a condition of machine code, names that
there are: none of them is what the former name meant."""


def public():
    """{name: function or class} of what is reachable through `__all__` of the faces, and the results that functions return."""
    found = {}
    for name in FACES:
        face = importlib.import_module(name)
        for word in getattr(face, "__all__", ()):
            each = getattr(face, word)
            if inspect.isfunction(each) or inspect.isclass(each):
                found[word] = each
    results = [Result]
    for each in results:
        results += each.__subclasses__()
    return {**{each.__name__: each for each in results if each.__module__.startswith("toolbox.")}, **found}


def words_of(each):
    """Arguments of a function; fields, properties and methods of a class that are its own or its ancestors' here."""
    if inspect.isfunction(each):
        return set(inspect.signature(each).parameters)
    fields = {field.name for field in dataclasses.fields(each)} if dataclasses.is_dataclass(each) else set()
    kinds = [kind for kind in each.__mro__ if kind.__module__.partition(".")[0] in ("toolbox", "models", "controllers")]
    return fields | {name for kind in kinds for name in (*vars(kind), *vars(kind).get("__annotations__", ()))}


PUBLIC = public()
METHODS = {
    f"{name}.{word}": method
    for name, each in PUBLIC.items()
    if inspect.isclass(each)
    for word in words_of(each)
    if not word.startswith("_") and inspect.isfunction(method := getattr(each, word, None))
}
"""{class.method: function} of all public methods."""


def test_no_former_name_stands_in_the_public_interface():
    assert len(PUBLIC) > 150
    left = [(place, old) for (place, old) in NOW if place in PUBLIC and old in words_of(PUBLIC[place])]
    assert not left
    anywhere = [(name, word) for name, each in PUBLIC.items() for word in NOWHERE & words_of(each) if not word.startswith("_")]
    anywhere += [(name, word) for name, method in METHODS.items() for word in NOWHERE & words_of(method)]
    assert not [pair for pair in anywhere if pair not in EXCEPTIONS]


def test_every_term_now_stands_where_the_vocabulary_says():
    for entry in ENTRIES:
        assert entry.meaning and entry.old != entry.new
        for place in entry.places.split():
            if place in PUBLIC and place not in ("Recording", "survives"):
                assert entry.new in words_of(PUBLIC[place]), (place, entry.new)


FUNCTIONS = [(place, old) for (place, old) in NOW if place in PUBLIC and inspect.isfunction(PUBLIC[place])]
CLASSES = [(place, old) for (place, old) in NOW if place in PUBLIC and inspect.isclass(PUBLIC[place])]


@pytest.mark.parametrize(("place", "old"), FUNCTIONS)
def test_a_function_refuses_a_former_argument_with_the_name_now(place, old):
    arguments = inspect.signature(PUBLIC[place]).parameters.values()
    needed = [each for each in arguments if each.default is each.empty and each.kind is each.POSITIONAL_OR_KEYWORD]
    given = [compose(BlockOnBelt()), *[None] * (len(needed) - 1)]
    with pytest.raises(SceneError, match=f"`{old}` of `{place}` is now `{NOW[place, old]}`"):
        PUBLIC[place](*given[: len(given)], **{old: None})


@pytest.mark.parametrize(("place", "old"), CLASSES)
def test_a_class_refuses_a_former_name_as_argument_and_as_attribute(place, old):
    kind = PUBLIC[place]
    with pytest.raises(AttributeError, match=f"`{old}` of `{kind.__name__}` is now `{NOW[place, old]}`"):
        getattr(object.__new__(kind), old)
    with pytest.raises(SceneError, match=f"`{old}` of `{kind.__name__}` is now"):
        kind(**{old: None})


OPTIONS = [(place.removeprefix("stickslip-"), old) for (place, old) in NOW if place.startswith("stickslip-")]


@pytest.mark.parametrize(("command", "old"), OPTIONS)
def test_a_command_refuses_a_former_option_with_the_option_now(command, old, capsys):
    assert command in COMMANDS
    with pytest.raises(SystemExit) as ended:
        main([command, "scene.toml", old, "x=1:2"])
    assert (
        ended.value.code == 2 and f"`{old}` of `stickslip {command}` is now `{NOW[f'stickslip-{command}', old]}`" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "write",
    [
        lambda path, heads: toolbox.files.printing.columns([heads, ("1", "2")]),
        lambda path, heads: toolbox.files.tables.write(path, heads, []),
    ],
)
def test_the_tests_notice_a_column_with_a_former_name(write, tmp_path):
    write(tmp_path / "table.csv", ("controller", "set-point"))
    with pytest.raises(AssertionError, match="the column `law` is now `controller`"):
        write(tmp_path / "table.csv", ("law", "set-point"))


@pytest.mark.parametrize(("package", "old"), [(place, old) for (place, old) in NOW if place in FACES])
def test_a_package_refuses_the_former_name_of_a_class_with_the_name_now(package, old):
    face = importlib.import_module(package)
    assert NOW[package, old] in PUBLIC
    with pytest.raises(AttributeError, match=f"`{old}` is now `{NOW[package, old]}`"):
        getattr(face, old)


def test_a_scene_with_the_former_name_of_a_class_loads_and_one_line_gives_the_name_now(root, tmp_path, capsys):
    text = (root / "studies" / "scenes" / "lugre_guide.toml").read_text(encoding="utf-8")
    former = text.replace('part = "GuideContact"', 'part = "Guide"')
    assert former != text
    (tmp_path / "scene.toml").write_text(former, encoding="utf-8")
    assert Scene.load(tmp_path / "scene.toml") == Scene.load(root / "studies" / "scenes" / "lugre_guide.toml")
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "`Guide` is now `GuideContact`" in told


def test_a_former_command_is_refused_with_the_one_now(capsys):
    with pytest.raises(SystemExit):
        main(["drives", "scene.toml"])
    assert "`drives` is now `setpoints`" in capsys.readouterr().err


def test_a_scene_with_former_keys_loads_and_one_line_gives_the_key_now(root, tmp_path, capsys):
    text = (root / "studies" / "scenes" / "drives.toml").read_text(encoding="utf-8")
    former = text.replace("delay_samples = 3", "late = 3")
    assert former != text
    (tmp_path / "scene.toml").write_text(former, encoding="utf-8")
    assert Scene.load(tmp_path / "scene.toml") == Scene.load(root / "studies" / "scenes" / "drives.toml")
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "the key `late` of `LQG` is now `delay_samples`" in told


def test_a_result_file_with_former_fields_loads(tmp_path):
    found = sweep(compose(BlockOnBelt()), {"block.mass": [1.0, 2.0]}, duration=5.0)
    found.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        arrays = {name: data[name] for name in data.files}
    text = str(arrays["result"])
    for old, new in (("measures", "metrics"), ("measure_units", "metric_units"), ("errors", "failures"), ("asked", "display_units")):
        assert f'"{new}":' in text
        text = text.replace(f'"{new}":', f'"{old}":')
    np.savez_compressed(tmp_path / "old.npz", **{**arrays, "result": np.array(text)})
    back = type(found).load(tmp_path / "old.npz")
    assert str(dataclasses.replace(back, seconds=found.seconds)) == str(found) and back.metrics.keys() == found.metrics.keys()


def test_a_file_of_set_points_with_former_groups_and_fields_loads(tmp_path):
    limit = SetPointLimit(8.0, "sticks", highest_set_point=9.0, time_above_setpoint=0.1, relapses_per_hour=2.0, disk_margin_nominal=0.5)
    now = {("PI", "nominal", "takeover"): limit, ("PI", "one_at_a_time", "ramp"): limit, ("PI", "other_rocks", "takeover"): limit}
    found = LowestSetPoints("stiff", now, (2.0, 9.0), 0.1)
    found.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        text = str(data["result"])
    former = (
        ("nominal", "declared"), ("one_at_a_time", "robust"), ("other_rocks", "rocks"), ("takeover", "direct"), ("ramp", "raised"),
        ("initial_controller", "before"), ("bounds", "between"), ("highest_set_point", "until"), ("time_above_setpoint", "above"),
        ("relapses_per_hour", "again"), ("disk_margin_nominal", "margin_declared"), ("lowest_set_point", "speed"),
    )  # fmt: skip
    for new, old in former:
        assert f'"{new}"' in text
        text = text.replace(f'"{new}"', f'"{old}"')
    np.savez_compressed(tmp_path / "old.npz", result=np.array(text))
    assert repr(LowestSetPoints.load(tmp_path / "old.npz")) == repr(found)


def test_a_class_of_a_user_that_declares_a_former_name_is_refused():
    with pytest.raises(SceneError, match="Attribute `measures` of `Mine` is now `measured_signals`"):

        class Mine(PI):
            measures = ("top.speed",)

    def law(t, y):
        return 0.0

    law.drives = ("top.torque",)
    with pytest.raises(SceneError, match="Attribute `drives` of a controller is now `actuated_signals`"):
        toolbox.closed_loop(compose(BlockOnBelt()), Sampled(law, 0.1)).system  # noqa: B018
    assert Lifting().unload_rate > 0 and models.__all__ and controllers.__all__
