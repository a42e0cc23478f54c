"""Results in files: what `save` writes `load` reads, alike for all; what is damaged or another thing is refused by a sentence."""

import dataclasses
import json
import math
import zipfile

import numpy as np
import pytest

from controllers import PI, SoftTorque, StiffPI
from models import (
    BitRock,
    Coulomb,
    FrictionCalibration,
    Section,
    SquealingPad,
    Survey,
    TorqueDrag,
    TorqueDragEffects,
    TorqueDragOperations,
    calibrate_friction,
    torque_drag,
    torque_drag_effects,
    torque_drag_operations,
    wells,
)
from models.squeal import SquealModes
from tests.plants import BELT, RIG
from toolbox import (
    Sampled,
    SceneError,
    closed_loop,
    compose,
    fit,
    lowest_set_point,
    margins,
    onset,
    severity_map,
    simulate,
    sweep,
    tune,
    work_precision,
    worst_case,
)
from toolbox.calibration.recording import Recording
from toolbox.calibration.results import Fit
from toolbox.calibration.validation import Validation, validate
from toolbox.contacts import ContactProblem, ContactRun, step_contacts
from toolbox.drilling import Answers, Estimates, Group, LowestSetPoints, Machine, Schedule, Windows, answers, estimate, schedule, windows
from toolbox.files.results import Result
from toolbox.measuring.metrics import mean
from toolbox.onsets.comparison import Comparison
from toolbox.onsets.results import Onset
from toolbox.onsets.severity_map import BorderPoints, SeverityMap
from toolbox.probability import (
    Basin,
    Chance,
    ModelComparison,
    Normal,
    Posterior,
    Prediction,
    UncertainOnset,
    Uniform,
    basin,
    chance,
    compare_models,
    posterior,
    predict,
    uncertain_onset,
)
from toolbox.robustness import Margins, SmallestError, WorstCase, smallest_error
from toolbox.robustness.charts import StabilityChart, stability_chart
from toolbox.robustness.describing import DescribingFunction, describing_function
from toolbox.robustness.responses import FrequencyResponse, frequency_response
from toolbox.scenes.work_precision import WorkPrecision
from toolbox.steady_states.shapes import ModeShapes, mode_shapes
from toolbox.sweeps import Sweep
from toolbox.tuning.results import Tuned


def of_onset():
    return onset(closed_loop(RIG, PI(4_000.0, 1_500.0)), "top.reference", ("30 rpm", "130 rpm"), num_values=3)


def of_comparison():
    found = of_onset()
    return Comparison({"PI": found}, {"another": "it failed"})


def of_sweep():
    found = sweep(BELT, {"block.mass": [0.5, 1.0], "belt.friction.decay": [2.0, 3.0]}, 20.0, metrics=("severity", "stuck"))
    return dataclasses.replace(found, seconds=0.0)  # files do not hold it


def of_severity_map():
    return severity_map(closed_loop(RIG, StiffPI()), {"top.reference": (3.0, 14.0), "bit.weight": ("50 kN", "110 kN")}, shape=(3, 3))


def of_border_points():
    return of_severity_map().border_points("sticking")


def of_squeal_modes():
    return SquealingPad().modes([0.1, 0.3, 0.5])


def of_margins():
    return margins(closed_loop(RIG, Sampled(SoftTorque(reference=8.0), 0.01, 0.03)), by_simulation=False)


def of_worst_case():
    return worst_case(closed_loop(RIG, SoftTorque(reference=9.0)), 20.0, uncertainty={"bit.weight": (0.9, 1.1)}, metrics=("peak",))


def of_lowest_set_point():
    loop = closed_loop(RIG, Sampled(SoftTorque(), 0.01, 0.03))
    quiet = Group("nominal", (Machine("nominal"),), noise=0.0, takeover_phases=(0.0,))
    return lowest_set_point(loop, StiffPI(), [quiet], protocols=["takeover"], bounds=("80 rpm", "110 rpm"), step="10 rpm", long_run=False)


def of_answers():
    return answers(
        {"soft torque": closed_loop(RIG, SoftTorque(reference="100 rpm"))}, StiffPI(), bounds=(9.0, 12.0), step=1.5, phases=1, duration=30.0
    )


def of_smallest_error():
    return smallest_error(closed_loop(RIG, SoftTorque(reference="80 rpm")), {"bit.weight": ("90 kN", "150 kN")}, 20.0)


def well(depth):
    return compose(dataclasses.replace(wells.JANSEN_2, stiffness=(473.0 * 2000.0 / depth,)), BitRock(weight=97_347.0))


def of_windows():
    over = {"top.reference": ("40 rpm", "120 rpm"), "bit.weight": ("50 kN", "110 kN")}
    return windows(well, ["2 km"], SoftTorque(reference=9.0), over, shape=(5, 3))


def of_schedule():
    return schedule(well, ("1 km", "2 km"), SoftTorque(reference=12.0), 20.0)


def of_work_precision():
    return work_precision(BELT, 2.0, methods=("explicit",), accuracies=(1e-3, 1e-6), repeats=1)


def of_tuning():
    return tune(RIG, StiffPI(reference=9.0), ("severity", "peak"), {"stiffpi.proportional": (500.0, 2000.0)}, duration=30.0, runs=10)


def of_fit():
    run = simulate(BELT, 4.0, output_times=np.linspace(0.0, 4.0, 401))
    data = {"time": run.time, "block.position": run["block.position"]}
    return fit(closed_loop(BELT), data, {"block.stiffness": None}, starts=1)


def of_chance():
    return chance(closed_loop(RIG, StiffPI()), {"top.reference": [4.0, 30.0]}, {"bit.weight": "80 kN +- 8 kN"}, draws=8)


def of_posterior():
    loop = closed_loop(RIG, StiffPI(reference=6.0))
    data, read = {"torque": Normal(7000.0, 500.0)}, {"torque": mean("top.torque", 20.0, 30.0)}
    return posterior(
        loop, data, {"bit.weight": Uniform("50 kN", "110 kN"), "bit.radius": Uniform(0.14, 0.17)}, 30.0, metrics=read, draws=32
    )


def of_estimate():
    run = simulate(closed_loop(RIG, StiffPI(reference=6.0)), 9.0, output_times=np.linspace(0.0, 9.0, 181))
    return estimate(RIG, {"time": run.time, **{name: run[name] for name in ("top.torque", "top.speed")}}, members=8)


def of_prediction():
    return predict(closed_loop(BELT), {"belt.friction.static": "0.5 +- 0.01"}, {"block.position": 0.01}, 2.0, draws=20)


def of_model_comparison():
    read = {name: mean("block.position", end - 1.0, end) for name, end in (("first", 1.0), ("second", 2.0))}
    models = {"one": closed_loop(BELT), "other": closed_loop(BELT)}
    priors = {label: {"belt.friction.static": Uniform(0.5, 0.8)} for label in models}
    data, left = {"first": Normal(0.1, 0.1)}, {"second": Normal(0.2, 0.1)}
    return compare_models(models, data, priors, 2.0, left_out=left, metrics=read, draws=32)


def of_uncertain_onset():
    return uncertain_onset(
        closed_loop(RIG, StiffPI()), "top.reference", (4.0, 30.0), {"bit.weight": "80 kN +- 8 kN"}, draws=4, num_values=3
    )


def of_frequency_response():
    return frequency_response(closed_loop(RIG, SoftTorque(reference=9.0)), [0.1, 1.0, 10.0])


def of_stability_chart():
    return stability_chart(
        closed_loop(RIG, PI(900.0, 500.0)), {"pi.proportional": (100.0, 2000.0), "pi.integral": (50.0, 900.0)}, shape=(3, 3)
    )


def of_describing_function():
    return describing_function(closed_loop(RIG, StiffPI(reference=10.0)))


def of_torque_drag():
    hole = Survey((0.0, 900.0), (0.0, 0.9), (0.0, 0.0))
    return torque_drag([Section(800.0, 0.127, 0.1086)], hole, 0.3, axial_speed=0.2, weight_on_bit="20 kN")


def of_torque_drag_operations():
    hole = Survey((0.0, 900.0), (0.0, 0.9), (0.0, 0.0))
    return torque_drag_operations([Section(800.0, 0.127, 0.1086)], hole, [(400.0, 0.2), (800.0, 0.3)], weight_on_bit="20 kN")


def of_friction_calibration():
    hole = Survey((0.0, 900.0), (0.0, 0.9), (0.0, 0.0))
    measured = {"depth": [500.0, 800.0], "picking up": ["150 kN", "220 kN"], "slacking off": ["120 kN", None]}
    return calibrate_friction(
        [Section(800.0, 0.127, 0.1086)], hole, measured, [400.0, 800.0], hook_weight="0 N", display_units={"N": "klbf"}
    )


def of_torque_drag_effects():
    hole = Survey((0.0, 900.0), (0.0, 0.9), (0.0, 0.0))
    return torque_drag_effects([Section(800.0, 0.127, 0.1086)], hole, [(400.0, 0.2), (800.0, 0.3)], weight_on_bit="20 kN")


def of_mode_shapes():
    return mode_shapes(closed_loop(RIG, StiffPI(reference=10.0)))


def of_basin():
    return basin(closed_loop(RIG, StiffPI(reference=10.0)), {"bit.speed": (0.0, "150 rpm")}, 12)


def of_recording():
    run = simulate(BELT, 8.0, output_times=np.linspace(0.0, 8.0, 161))
    speed = run["block.speed"].copy()
    speed[40:45] = math.nan  # no data: a flaw
    return Recording.of({"time": run.time, "block.position": run["block.position"], "block.speed": speed}, BELT)


def of_validation():
    return validate(closed_loop(BELT), of_recording())


MADE = {
    Sweep: of_sweep, Onset: of_onset, SeverityMap: of_severity_map,
    Comparison: of_comparison, Margins: of_margins, WorstCase: of_worst_case, LowestSetPoints: of_lowest_set_point,
    Answers: of_answers,
    SmallestError: of_smallest_error, WorkPrecision: of_work_precision, Tuned: of_tuning, Fit: of_fit, Chance: of_chance, Posterior: of_posterior,
    Schedule: of_schedule, Windows: of_windows, Estimates: of_estimate, Basin: of_basin,
    Prediction: of_prediction, ModelComparison: of_model_comparison, UncertainOnset: of_uncertain_onset,
    FrequencyResponse: of_frequency_response, StabilityChart: of_stability_chart, ModeShapes: of_mode_shapes,
    DescribingFunction: of_describing_function, TorqueDrag: of_torque_drag, TorqueDragOperations: of_torque_drag_operations,
    FrictionCalibration: of_friction_calibration, TorqueDragEffects: of_torque_drag_effects,
    Recording: of_recording, Validation: of_validation, BorderPoints: of_border_points, SquealModes: of_squeal_modes,
}  # fmt: skip


@pytest.fixture(scope="module", params=MADE, ids=lambda kind: kind.__name__)
def result(request):
    return MADE[request.param]()


def same(one, other):
    """Whether two values of fields are the same, bit by bit."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True) and one.dtype == other.dtype
    if dataclasses.is_dataclass(one):
        kept = [each.name for each in dataclasses.fields(one) if each.metadata.get("saved", True)]
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in kept)
    if isinstance(one, tuple | list):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return list(one) == list(other) and all(map(same, one.values(), other.values()))
    return one == other or (isinstance(one, float) and math.isnan(one) and math.isnan(other))


def test_every_result_is_read_as_it_was_written(result, tmp_path):
    again = type(result).load(result.save(tmp_path / "found.npz"))
    assert same(result, again) and str(again) == str(result) and repr(again)
    if hasattr(result, "_repr_html_"):
        assert again._repr_html_() == result._repr_html_()


def test_every_result_that_was_read_is_drawn(result, tmp_path):
    again = type(result).load(result.save(tmp_path / "found.npz"))
    if not isinstance(result, (Sweep, BorderPoints)):  # of any numbers and measures; drawn in the figure of the map
        lines, others = ([line.get_xydata() for ax in np.ravel(each.plot()) for line in ax.lines] for each in (result, again))
        assert lines and same([np.asarray(each) for each in lines], [np.asarray(each) for each in others])


def test_a_path_that_ends_with_csv_is_a_table(result, tmp_path):
    assert result.save(tmp_path / "found.csv").read_bytes() == result.to_csv(tmp_path / "again.csv").read_bytes()
    with pytest.raises(SceneError, match=f"must be a file written by `{type(result).__name__}.save`"):
        type(result).load(tmp_path / "found.csv")
    with pytest.raises(SceneError, match="names no file"):
        result.save("")


def test_another_result_is_refused_by_its_kind(result, tmp_path):
    path = result.save(tmp_path / "found.npz")
    for kind in MADE:
        if kind is not type(result):
            with pytest.raises(SceneError, match=f"it holds a result of the kind {type(result).__name__}"):
                kind.load(path)


def test_a_changed_entry_is_refused(result, tmp_path):
    path = result.save(tmp_path / "found.npz")
    with np.load(path) as data:
        held = dict(data)
    tree = json.loads(str(held["result"]))
    for name in tree["fields"]:
        wrong = {**tree, "fields": {**tree["fields"], name: {"neither": "nor"}}}
        np.savez(tmp_path / "wrong.npz", **{**held, "result": np.array(json.dumps(wrong))})
        with pytest.raises(SceneError, match="must be a file written by"):
            type(result).load(tmp_path / "wrong.npz")
        own = next(each for each in dataclasses.fields(result) if each.name == name)
        if own.default is not dataclasses.MISSING or own.default_factory is not dataclasses.MISSING:
            continue  # what a later version adds has a default, by which older files are read
        less = {**tree, "fields": {key: value for key, value in tree["fields"].items() if key != name}}
        np.savez(tmp_path / "less.npz", **{**held, "result": np.array(json.dumps(less))})
        with pytest.raises(SceneError, match=f"has no '{name}'"):
            type(result).load(tmp_path / "less.npz")
    with zipfile.ZipFile(path) as archive:
        assert not any(b"pickle" in archive.read(name)[:200] for name in archive.namelist())


def test_what_belongs_to_the_machine_is_asked_for(tmp_path):
    tuned, fitted = of_tuning(), of_fit()
    loaded, read = Tuned.load(tuned.save(tmp_path / "tuned.npz")), Fit.load(fitted.save(tmp_path / "fit.npz"))
    with pytest.raises(SceneError, match=r"dataclasses.replace\(found, loop=loop\)"):
        loaded.law  # noqa: B018
    assert dataclasses.replace(loaded, loop=tuned.loop).law == tuned.law
    for name in ("parameters", "loop", "plant"):
        with pytest.raises(SceneError, match=r"loop.at\(name, fit\[name\]\)"):
            getattr(read, name)
    assert read["block.stiffness"] == fitted["block.stiffness"]


def test_arrays_in_a_file_are_named_by_where_they_stand(tmp_path):
    found, swept = of_severity_map(), of_sweep()
    with np.load(found.save(tmp_path / "map.npz")) as data:
        assert same(data["array.sticking.severity"], found.sticking.severity) and same(data["array.axes.1"], found.axes[1])
    with np.load(swept.save(tmp_path / "sweep.npz")) as data:
        assert same(data["array.metrics.severity"], swept["severity"]) and same(data["array.points"], swept.points)


def test_the_table_of_a_recording_is_read_as_a_log(tmp_path):
    found = of_recording()
    again = Recording.of(found.save(tmp_path / "log.csv"), BELT)
    assert same(again.time, found.time) and same(again.signals, found.signals)


def test_a_function_of_the_users_own_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"cannot be saved: a file holds one of builtins.max"):
        dataclasses.replace(of_tuning(), aggregate=lambda values: values[0]).save(tmp_path / "tuned.npz")
    assert not list(tmp_path.iterdir())


def test_a_run_of_many_contacts_is_read_as_it_was_written(tmp_path):
    tangent = np.array([[[1.0, 0.0]], [[0.0, 1.0]]])
    problem = ContactProblem(
        mass=np.diag([1.0, 2.0]), stiffness=np.array([[3.0, -1.0], [-1.0, 2.0]]), tangent=tangent, friction=Coulomb(0.4, 0.3),
        load=np.array([5.0, 6.0]), force_inputs={"push": np.array([1.0, 0.0])}, outputs={"front": np.array([0.0, 1.0])},
        contact_positions=np.array([[0.0], [1.0]]), units={"front": "m"},
    )  # fmt: skip
    run = step_contacts(problem, 5.0, step=0.01, inputs={"push": 4.0})
    again = ContactRun.load(run.save(tmp_path / "run.npz"))
    for name in ("time", "coordinates", "rates", "contact_modes", "normal", "tangential", "slip", "friction_work", "newton_iterations"):
        assert same(getattr(run, name), getattr(again, name)), name
    assert same(run["front.speed"], again["front.speed"]) and same(run.pressure, again.pressure)
    assert again.problem.friction == problem.friction and run.audit() == again.audit() and str(again) == str(run)
    assert same(run.inputs, again.inputs) and again.to_csv(tmp_path / "b.csv").read_bytes() == run.save(tmp_path / "a.csv").read_bytes()
    with np.load(tmp_path / "run.npz") as data:
        held = dict(data)
    for name in ("normal", "input.push", "energy.kinetic", "coordinates"):
        np.savez(tmp_path / "wrong.npz", **{**held, name: held[name][:-1]})
        with pytest.raises(SceneError, match="which does not fit to its other arrays"):
            ContactRun.load(tmp_path / "wrong.npz")
    other = str(held["run"]).replace("models.friction.Coulomb", "models.friction.Nobodys")
    np.savez(tmp_path / "wrong.npz", **{**held, "run": np.array(other)})
    with pytest.raises(SceneError, match="has the friction law `models.friction.Nobodys`, which is not known here"):
        ContactRun.load(tmp_path / "wrong.npz")


def test_every_kind_of_result_stands_here():
    assert set(Result.__subclasses__()) == set(MADE)
