"""Control laws for elsewhere: as C for the controller of a real machine, and as state space of python-control for its tools.

Both are read off the equations that the law states once, with its numbers filled in by `design`: what runs on the machine is what was simulated.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.errors import SceneError, suggest
from toolbox.export.from_control import LinearLaw
from toolbox.export.law_text import Declared, c_paths, written
from toolbox.export.refusals import Refusals, closed_bounds, refusals_of
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.clamps import passing_nan
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.components import Slot, check_fields, first_word, law_of, numbers_of, own_word, rebuilt, remembered, symbolic_copy
from toolbox.modelling.elements import State, time
from toolbox.modelling.laws import Controller, Sampled, check_sampled, names
from toolbox.modelling.observers import Observer
from toolbox.steady_states.linear import control_name
from toolbox.vocabulary import new_names_only


@dataclass(frozen=True)
class OpenLaw:
    """A law by itself, with numbers in place of its parameters: its inputs, its memory, and its outputs.

    reads: {signal: (symbol, unit, default or None)}, those without default first, in the order in which the law asks, what it drives itself as
    `<signal>.held`, the value held until the sample;  memory: its states;
    following: their next values (sampled) or rates (continuous);  gives: {signal: (expression, unit)};  period: sample time [s], None where it is continuous.
    gains: [(name, unit, value, symbol)] of the numbers that are still symbols.
    """

    title: str
    reads: dict[str, tuple[ca.SX, str, float | None]]
    memory: tuple[State, ...]
    following: ca.SX
    gives: dict[str, tuple[ca.SX, str]]
    actuated_signals: tuple[str, ...]
    period: float | None
    gains: tuple[tuple[str, str, float, ca.SX], ...] = ()

    @property
    def y(self) -> ca.SX:
        """What is read, as one column."""
        return ca.vertcat(*[symbol for symbol, _, _ in self.reads.values()]) if self.reads else ca.SX(0, 1)

    @property
    def z(self) -> ca.SX:
        """The memory, as one column."""
        return ca.vertcat(*self.memory) if self.memory else ca.SX(0, 1)

    @property
    def labels(self) -> list[tuple[str, str]]:
        """(name, unit) of every entry of the memory."""
        return [
            (variable.label if variable.length is None else f"{variable.label}.{i}", variable.unit)
            for variable in self.memory
            for i in range(count_of(variable.length))
        ]


def only_law(loop: ClosedLoop) -> tuple[Any, float | None]:
    """The law of a loop as designed, with the numbers of the loop, and its period; None for a continuous one.

    Raises SceneError unless there is exactly one law, and it is a Controller.
    """
    if len(loop.controllers) != 1:
        raise SceneError(f"Argument `loop` must hold exactly one law to be written down, but it holds {len(loop.controllers)}.")
    given = loop.controllers[0]
    if not isinstance(given.law if isinstance(given, Sampled) else given, Controller):
        raise SceneError(f"Argument `loop` must hold a Controller to be written down, but its law is {given!r}.")
    closed, law = loop.assembly, loop.designed_controllers[0]
    if isinstance(law, Controller) and any(not loop.plant.has_parameter(name) for name in loop.parameters):
        *plant, part = closed.system.parts
        law = law_of(rebuilt(part, closed.system.values, sum(len(numbers_of(each)) for each in plant)))
    return law, float(given.period) if isinstance(given, Sampled) else None


def opened(law: Any, period: float | None, gains: bool = False) -> OpenLaw:
    """Return a law by itself, sampled or (None) continuous. Its numbers are constants; `gains` makes symbols of the numbers with which it
    computes.

    Raises SceneError where it has no equations of that kind.
    """
    title = type(law if isinstance(law, Controller) else getattr(law, "law", law)).__name__  # of a designed one the law that was given
    if not isinstance(law, Controller):
        raise SceneError(f"The law must be held by casadi expressions, but {title} is a Python callable: it runs in Python alone.")
    check_fields(law)
    if period is not None:
        check_sampled(law, float(period))
    slots, numbers = list[Slot](), numbers_of(law)
    if gains:
        law = symbolic_copy(law, "", slots)
    symbols = ca.vertcat(*[slot.symbol for slot in slots])
    reads: dict[str, tuple[ca.SX, str, float | None]] = {}
    driven = names(law.actuated_signals)

    def number_of(expression: Any) -> float:
        return float(ca.evalf(ca.substitute(ca.SX(expression), symbols, ca.DM(numbers)))) if slots else float(expression)

    def signal(name: str, unit: str, default: Any = None) -> ca.SX:
        if name in driven:  # what was held before, under a name of its own
            name = f"{name}.held"
        if name not in reads:
            reads[name] = (ca.SX.sym(name), unit, None if default is None else number_of(default))
        return reads[name][0]

    if period is None:
        equations = law.continuous(signal)
        if equations.elements:
            element = remembered(equations.elements[0].name, own_word(law, equations.flow), first_word(law))
            raise SceneError(f"{title} switches by a set-valued element, `{element}`, and has no form without it.")
        memory, gives = equations.flow, equations.outputs
    else:
        update = law.sampled(signal, ca.SX(float(period)))
        memory, gives = update.memory, update.outputs
    prefix = own_word(law, memory)
    for variable in memory:
        variable.label = remembered(variable.label, prefix, first_word(law))
    following = ca.densify(ca.vertcat(*[ca.SX(value) for value in memory.values()])) if memory else ca.SX(0, 1)
    found = {name: (ca.SX(value), unit) for name, (value, unit) in gives.items()}
    reads = dict(sorted(reads.items(), key=lambda item: item[1][2] is not None))  # what is measured, then set-points
    every = ca.vertcat(following, *[value for value, _ in found.values()])
    if ca.depends_on(every, time):
        raise SceneError(f"{title} depends on time itself, which a law by itself does not know.")
    entries = [(slot, name, symbol) for slot in slots for name, symbol in _entries(slot)]
    known = zip(entries, numbers, strict=True) if gains else ()
    used = tuple(
        (name, slot.spec.metadata.get("unit", "1"), value, symbol) for (slot, name, symbol), value in known if ca.depends_on(every, symbol)
    )
    return OpenLaw(title, reads, tuple(memory), following, found, names(law.actuated_signals) or tuple(found), period, used)


def _refusals(made: Controller, law: OpenLaw) -> Refusals:
    """What the gains of a law by itself must be."""
    slots = list[Slot]()
    symbolic_copy(made, "", slots)
    names = [(name, slot) for slot in slots for name, _ in _entries(slot)]
    places = {
        place: [gain for gain, *_ in law.gains].index(name)
        for place, (name, _) in enumerate(names)
        if name in {gain for gain, *_ in law.gains}
    }
    bounds = {places[place]: closed_bounds(slot.spec.metadata) for place, (_, slot) in enumerate(names) if place in places}
    return refusals_of([bounds[i] for i in range(len(law.gains))], [made], places)


def _entries(slot: Slot) -> list[tuple[str, ca.SX]]:
    """(name, symbol) of every number of a field."""
    if slot.size is None:
        return [(slot.field_path, slot.symbol)]
    return [(f"{slot.field_path}.{i}", slot.symbol[i]) for i in range(slot.size)]


# --------------------------------------------------------------------------------------------------------------------------------- python-control
@new_names_only
def to_control(controller: Controller | Sampled | ClosedLoop, *, outputs: str | Sequence[str] | None = None) -> Any:
    """Return a linear controller as a `control.StateSpace` of python-control.

        z' = A z + B (y - y0),  u = u0 + C z + D (y - y0)     or     z_(k+1) = A z_k + B (y_k - y0),  u_k = u0 + C z_k + D (y_k - y0)

    - The inputs of the system are the measured signals and then the set-points. The outputs are the actuated signals.
      Their names are the names that `linearise` gives them.
    - The system describes deviations from the operating point (y0, u0). `system.law` holds the operating point and the
      signal names of the toolbox, so `from_control(to_control(controller))` is the controller again. A system that
      python-control computes from this system has no attribute `law`.
    - The outputs have the sign with which they act on the plant. Close the loop with `control.feedback(plant,
      controller, sign=1)`.
    - Delay, noise and resolution of a `Sampled` controller are not in the system. Multiply the system by 1 / z for
      every sample of delay, or use `toolbox.margins`, which includes the delay.

    Parameters
    ----------
    controller
        A loop with one controller, which is designed on its plant; or a controller with all its numbers. `Sampled`
        gives the sampled form with its period as dt.
    outputs
        Additional signals that the controller computes. By default, for an observer, all estimates that are linear.

    Returns
    -------
    control.StateSpace
        The linear system.

    Raises
    ------
    SceneError
        If the controller is not linear, has torque limits, or switches; the message names the reason.

    Examples
    --------
    >>> from controllers import PI
    >>> from toolbox import to_control
    >>> system = to_control(PI(proportional=400.0, integral=200.0, reference="60 rpm"))
    >>> print(system.input_labels, system.D)
    ['top_speed', 'top_reference'] [[-400.  400.]]
    """
    import control

    given, period = (
        only_law(controller)
        if isinstance(controller, ClosedLoop)
        else (controller.law, float(controller.period))
        if isinstance(controller, Sampled)
        else (controller, None)
    )
    made = settled(opened(given, period))
    wanted = _linear_outputs(made, given, outputs)
    known = ca.vertcat(made.z, made.y)
    labels = [label for label, _ in made.labels]
    given_out = ca.vertcat(*[made.gives[name][0] for name in wanted]) if wanted else ca.SX(0, 1)
    slopes = [ca.jacobian(each, by) for each in (made.following, given_out) for by in (made.z, made.y)]
    constants = [ca.substitute(each, known, ca.DM.zeros(known.numel())) for each in (made.following, given_out)]
    A, B, C, D, moved, driven = (np.array(ca.evalf(ca.densify(each))) for each in (*slopes, *constants))
    found = control.ss(
        A, B, C, D, dt=0 if period is None else period, inputs=[_entry(name) for name in made.reads],
        outputs=[_entry(name) for name in wanted], states=[_entry(label) for label in labels] or None, name=made.title,
    )  # fmt: skip
    found.law = _about(made, wanted, B, D, moved.ravel(), driven.ravel())
    return found


def _linear_outputs(made: OpenLaw, law: Any, outputs: str | Sequence[str] | None) -> tuple[str, ...]:
    """The signals that the system of a law gives; raises SceneError where one is unknown or the law is not linear."""
    known = ca.vertcat(made.z, made.y)
    wanted = names(outputs) if outputs is not None else made.actuated_signals
    for name in wanted:
        if name not in made.gives:
            raise SceneError(
                f"Argument `outputs` must name signals that {made.title} gives, but `{name}` is none: {suggest(name, made.gives)}"
            )
    if outputs is None and isinstance(law, Observer):
        wanted = tuple(name for name in wanted if _linear(made.gives[name][0], known))
    labels = [label for label, _ in made.labels]
    for label, expression in [*zip(labels, ca.vertsplit(made.following), strict=True), *((name, made.gives[name][0]) for name in wanted)]:
        if not _linear(expression, known):
            limited = ", which its torque limits make it: leave them out" if getattr(law, "limits_known", False) else ""
            raise SceneError(f"{made.title} must be a linear law, but `{label}` is not linear in what it reads{limited}.")
    return wanted


def _about(law: OpenLaw, outputs: Sequence[str], B: np.ndarray, D: np.ndarray, moved: np.ndarray, driven: np.ndarray) -> LinearLaw | None:
    """The working point about which a law without constants is the law z' = A z + B y + moved, u = C z + D y + driven; None where there is none."""
    point = -np.linalg.lstsq(B, moved, rcond=None)[0] if moved.any() else np.zeros(B.shape[1])
    if np.abs(B @ point + moved).max(initial=0.0) > 1e-9 * np.abs(moved).max(initial=0.0):
        return None
    at = dict(zip(law.reads, point.tolist(), strict=True)) | dict(zip(outputs, (driven + D @ point).tolist(), strict=True))
    defaults = {name: default for name, (_, _, default) in law.reads.items() if default is not None}
    return LinearLaw(tuple(law.reads), tuple(outputs), at, defaults)


def settled(law: OpenLaw) -> OpenLaw:
    """Return a law in its form after the first sample. Scalars of its memory that are constant then become numbers, and unused readings of
    its own torques are left out."""
    constant = {
        variable: value
        for variable, value in zip(law.memory, ca.vertsplit(law.following, _places(law.memory)), strict=True)
        if variable.length is None and ca.SX(value).is_constant()
    }
    if not constant:
        return law
    old, new = [ca.SX(variable) for variable in constant], list(constant.values())
    *gives, following = ca.substitute([value for value, _ in law.gives.values()] + [law.following], old, new)
    kept = tuple(variable for variable in law.memory if variable not in constant)
    pieces = zip(law.memory, ca.vertsplit(following, _places(law.memory)), strict=True)
    following = ca.vertcat(ca.SX(0, 1), *[piece for variable, piece in pieces if variable not in constant])
    found = {name: (value, unit) for (name, (_, unit)), value in zip(law.gives.items(), gives, strict=True)}
    every = ca.vertcat(following, *gives)
    reads = {name: row for name, row in law.reads.items() if not name.endswith(".held") or ca.depends_on(every, row[0])}
    return dataclasses.replace(law, memory=kept, following=following, gives=found, reads=reads)


def _places(memory: Sequence[Any]) -> list[int]:
    """Where each of the memory begins in its vector, and the end."""
    return [0, *np.cumsum([variable.numel() for variable in memory]).tolist()]


def _entry(name: str) -> str:
    """The name that `linearise` gives to the same signal, so that python-control connects the two: chain_speed[0] for chain.speed.0."""
    return control_name(re.sub(r"\.(\d+)$", r"[\1]", name))


def _linear(expression: ca.SX, symbols: ca.SX) -> bool:
    """Whether an expression is a constant plus a sum of numbers times symbols, by the symbols themselves."""
    return not ca.depends_on(ca.densify(ca.jacobian(expression, symbols)), symbols)


# --------------------------------------------------------------------------------------------------------------------------------------------- C
@sign_of_life("export_c is at work")
@takes_loop
def export_c(
    loop: ClosedLoop, path: str | Path, *, part: str | None = None, duration: NumberOrText | None = None, accuracy: float | None = None
) -> tuple[Path, Path]:
    """Write a sampled controller, or a plant with its controllers, as C99 code that needs only math.h.

    The code allocates no memory and has no global variables.

    **A controller** becomes NAME.c and NAME.h, for the control system of a real machine:

        void NAME_start(double *memory);
        int NAME_step(const double *y, double *memory, double *u);     0 for success
        void NAME_gains(double *gains);
        int NAME_step_with(const double *gains, const double *y, double *memory, double *u);

    - Call `NAME_step` once per sample. It reads the measured signals and the set-points from y and writes the actuated
      signals to u. The header lists their order, units and defaults.
    - If a command or a value of the memory is not a finite number, `NAME_step` returns NAME_NOT_FINITE and changes
      nothing.
    - `NAME_step_with` does the same with other gains. `NAME_gains` writes the gains of the controller. Gains that
      Python would refuse are refused with NAME_OUTSIDE.
    - The input `top.torque.held` in y is the torque that acts before this sample, 0 if no torque acts. At its first
      sample the controller begins at this torque (bumpless start).
    - The caller allocates the memory. The code contains no delays, no noise and no hold between samples, because the
      real machine has them.
    - A controller that is no casadi expression can be exported if the object that its `design` returns has a method
      `export_c(c, h, period)`, which writes the code. `LinearMPC` has such a method. Its code contains a solver in a
      folder NAME_osqp and has no gains.

    **A loop**, or a plant without controllers, becomes a folder NAME with NAME.c, NAME.h, an example main.c,
    CMakeLists.txt and README.md, for programs that simulate it:

        void NAME_start(NAME *w);
        int NAME_set(NAME *w, int number, double value);      an input or a parameter
        int NAME_step(NAME *w, double until);                 to a time; every switch on the way is located
        void NAME_outputs(const NAME *w, double *y);          and modes, events, names

    - The code contains the event loop of the toolbox with explicit steps, and the controllers with their sample times,
      delays and noise.
    - All variables are in one struct, so a copy of the struct is a saved state.
    - A call makes a bounded number of steps and switches. It returns NAME_OVERRUN if more are needed.
    - Before `export_c` writes the code, it simulates the loop once over `duration`, to check that the run succeeds.

    Parameters
    ----------
    loop
        A loop with one sampled controller, which is written with its period and its numbers on the plant. Or, for
        `part="loop"`, any loop or plant.
    path
        For a controller the path of either file, with or without suffix. For a loop the folder. The name of the file or
        folder is the NAME of the functions.
    part
        "law" for the controller, or "loop". By default "law" if the loop has a controller, otherwise "loop".
    duration
        Time over which the accuracy of a loop is promised [s]. By default the duration of its scene. The machine can
        run on after it.
    accuracy
        Target for the global error of a loop, between 1e-13 and 0.1. By default the accuracy of its scene, else 1e-6.

    Returns
    -------
    tuple of Path
        The paths of NAME.c and NAME.h.

    Raises
    ------
    SceneError
        If NAME is not a valid name in C, or a file cannot be written. For a controller: if the loop does not contain
        exactly one `Sampled` with a `Controller`, or this controller is no casadi expression. For a loop: if it is
        stiff, so that it needs implicit steps, or one of its controllers is no casadi expression.
    SimulationError
        If the run fails.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, export_c
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms"))
    >>> source, header = export_c(loop, "drive")
    >>> print(source.name, header.name, header.read_text().count("int drive_step("), "step function")
    drive.c drive.h 1 step function
    """
    if part not in (None, "law", "loop"):
        raise SceneError(f'Argument `part` must be "law" or "loop", but it is {part!r}.')
    if part == "loop" or (part is None and not loop.controllers):
        from toolbox.export.machine_c import written_machine  # here, because few programs need it

        return written_machine(loop, path, duration, accuracy)
    if duration is not None or accuracy is not None:
        raise SceneError('Arguments `duration` and `accuracy` belong to `part="loop"`, but a law is written, which has none.')
    c, h = c_paths(path)
    declared_c(loop, path)
    return c, h


def declared_c(loop: ClosedLoop, path: str | Path) -> Declared:
    """Write a law like `export_c`, and return the content of the list in its header."""
    made, period = only_law(loop)
    if period is None:
        raise SceneError(
            "Argument `loop` must hold a sampled law to be written as C, but its law is continuous: give `sample_time` to `closed_loop`."
        )
    c, h = c_paths(path)
    if hasattr(made, "export_c"):
        return made.export_c(c, h, period)
    law = opened(made, period, gains=True)
    driven = ca.vertcat(*[law.gives[name][0] for name in law.actuated_signals])
    gains = ca.vertcat(ca.SX(0, 1), *[symbol for _, _, _, symbol in law.gains])
    results = passing_nan([driven, law.following], gains)
    step = ca.Function(f"{c.stem}_law", [law.y, law.z, gains], results, ["y", "memory", "gains"], ["u", "next"])
    if step.has_free():
        raise SceneError(f"{law.title} depends on {', '.join(step.get_free())}, which a law by itself does not know.")
    reads = [(name, unit, default) for name, (_, unit, default) in law.reads.items()]
    drives = [(name, law.gives[name][1]) for name in law.actuated_signals]
    declared = Declared(
        law.title, c.stem, period, reads, law.labels, drives, gains=[(f"law.{name}", unit, value) for name, unit, value, _ in law.gains],
        refusals=_refusals(made, law),
    )  # fmt: skip
    return written(c, h, declared, [step])
