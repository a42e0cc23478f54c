"""Assertions on runs for the tests of a control law: each says in numbers what failed, and saves a figure of it.

The pytest plugin gives them as the fixture `stickslip_checks`; elsewhere, `Checks(folder=..., name=...)` does the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import is_finite_number
from toolbox.errors import SceneError
from toolbox.measuring import measure
from toolbox.measuring.judge import SMOOTH
from toolbox.measuring.sticks import is_stick, stick_intervals, stick_time
from toolbox.measuring.verdict import growth_in_words
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.onsets.coming_to import verdict_on
from toolbox.onsets.onset import onset
from toolbox.onsets.results import Onset
from toolbox.robustness.margins import Margins, margins
from toolbox.robustness.outcomes import WorstCase
from toolbox.robustness.worst_case import worst_case
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Perturbation:
    """Deviation of the machine from its declared numbers, as fractions: {"bit.weight": 0.2} is a weight 20 % above the declared weight."""

    parts: Mapping[str, float]

    def __call__(self, plant: HybridSystem) -> dict[str, Any]:
        """{parameter: perturbed value} of a plant, for `simulate(..., parameters=...)`; raises SceneError for unknown parameters."""
        return {name: plant.parameter(name) * (1.0 + part) for name, part in self.parts.items()}


@dataclass(frozen=True)
class Checks:
    """Assertions on runs. Each raises AssertionError with its numbers, or returns the measured value.

    Parameters
    ----------
    folder
        Folder of the figure that a failed check draws.
    name
        What the name of that file begins with.
    """

    folder: Path
    name: str = "check"

    def no_stick_slip(self, run: Trajectory, after: float, element: str | None = None) -> None:
        """No stick phase, however short, touches the time after `after` [s], and none comes when the run goes on with its inputs as they are at its end.

        A run whose inputs go on changing, and one that is shorter than a swing, is judged by itself alone. element: the contact; the only one without.
        """
        __tracebackhide__ = True
        contact = judged_contact(run.program.system, element)
        words, judged = verdict_on(run, contact, judged_speed(run.program.system, contact), after)
        sticks = stick_intervals(run, contact, after)
        lengths = [last - first for first, last in sticks]
        if is_stick(sum(lengths), run.end - after):
            self._fail(
                "no_stick_slip",
                f"`{contact}` must not stick after {after:g} s, but it sticks {len(sticks)} time(s) for {sum(lengths):.4g} s in all, the longest "
                f"{max(lengths):.4g} s, first at {sticks[0][0]:.4g} s: {words}, {words.reason}",
                lambda: run.plot(),
            )
        if judged is not None and (judged.rate > 0 or words.stick_slip):
            coming = (
                f"a small disturbance of smooth running {growth_in_words(judged.rate)}" if judged.rate > 0 else f"{words}: {words.reason}"
            )
            self._fail(
                "no_stick_slip",
                f"`{contact}` must not stick after {after:g} s: it does not until {run.end:g} s, but {coming}",
                lambda: run.plot(),
            )

    def severity_below(self, run: Trajectory, limit: float, after: float, signal: str | None = None) -> float:
        """The severity of a speed, half its range by its mean, is below a limit after `after` [s]; returns it. signal: by default the judged speed."""
        __tracebackhide__ = True
        signal = signal or judged_speed(run.run.loop, judged_contact(run.run.loop))
        value = measure.severity(run, signal, after)
        if not value < limit:
            found = measure.extent(run, signal, after)
            unit = run.unit(signal)
            self._fail(
                "severity_below",
                f"The severity of `{signal}` after {after:g} s must be below {limit:g}, but it is {value:.4g}: "
                f"{found.minimum:.5g} .. {found.maximum:.5g} {unit}, mean {found.mean:.5g} {unit}",
                lambda: run.plot(signal),
            )
        return value

    def bounded(self, run: Trajectory, signal: str, low: float = -math.inf, high: float = math.inf, after: float = 0.0) -> None:
        """A signal stays within [low, high] after `after` [s], between the steps, too."""
        __tracebackhide__ = True
        self._within("bounded", run, signal, (low, high), after)

    def _within(self, check: str, run: Trajectory, signal: str, ends: tuple[float, float], after: float) -> None:
        """What `bounded` asks, under the name of the check that asks it; the figure shows the limits."""
        __tracebackhide__ = True
        low, high = ends
        found = measure.extent(run, signal, after)
        unit = run.unit(signal)
        for value, when, broken, word in (
            (found.maximum, found.time_of_maximum, found.maximum > high, f"<= {high:.6g}"),
            (found.minimum, found.time_of_minimum, found.minimum < low, f">= {low:.6g}"),
        ):
            if broken:
                self._fail(
                    check,
                    f"`{signal}` must be {word} {unit} after {after:g} s, but it is {value:.6g} {unit} at {when:.4g} s",
                    lambda: _with_limits(run, signal, ends),
                )

    def settles(self, run: Trajectory, signal: str, target: float, within: float, band: float = 0.02, after: float = 0.0) -> float:
        """A signal stays within `band` (a part of the target) of its target from `within` seconds after `after` on; returns the time it takes."""
        __tracebackhide__ = True
        taken = measure.settling(run, signal, target, band, after=after)
        if not taken <= within:
            unit = run.unit(signal)
            end = float(np.ravel(run.at(run.end)[signal])[0])
            words = "it never does" if math.isinf(taken) else f"it takes {taken:.4g} s"
            self._fail(
                "settles",
                f"`{signal}` must settle to {target:.6g} {unit} +- {100 * band:g} % within {within:g} s, but {words}, and ends at {end:.6g} {unit}",
                lambda: run.plot(signal),
            )
        return taken

    def respects_limits(self, run: Trajectory, limits: Mapping[str, float | tuple[float, float]], after: float = 0.0) -> None:
        """Every signal keeps its limit: a number is the largest absolute value, a pair is (lowest, highest)."""
        __tracebackhide__ = True
        if not limits:
            raise SceneError("Argument `limits` must hold at least one limit, but it is empty.")
        for signal, limit in limits.items():
            low, high = limit if isinstance(limit, tuple) else (-abs(limit), abs(limit))
            self._within("respects_limits", run, signal, (low, high), after)

    def energy_balances(self, run: Trajectory, within: float = 1e-5) -> float:
        """Assert that stored energy, losses and supplies agree within a fraction of the energy turned over, and return the missing
        fraction."""
        __tracebackhide__ = True
        audit = measure.energy_audit(run)
        if not audit.relative <= within:
            text = f"The energy must balance within {within:.1e}, but {audit.relative:.1e} of it is missing:\n{audit}"
            self._fail("energy_balances", text, lambda: run.plot())
        return audit.relative

    def onset_below(
        self, loop: ClosedLoop | HybridSystem, parameter: str, limit: float, bounds: tuple[float, float], **arguments: Any
    ) -> Onset:
        """From `limit` to the end of the range the machine is free: the borders of smooth running, of existing stick-slip and of standstill lie below.

        All other arguments are those of `toolbox.onset`. The borders count with their tolerance. Returns the onset.
        """
        __tracebackhide__ = True
        if not is_finite_number(limit) or not bounds[0] < limit <= bounds[1]:
            raise SceneError(f"Argument `limit` must be in the range {bounds[0]:g} .. {bounds[1]:g}, but it is {limit!r}.")
        found = onset(as_loop(loop).at(parameter, limit), parameter, bounds, **arguments)
        late = [(name, border) for name, border in found.borders if border.value + border.tolerance > limit]
        lasting = [
            name for name, branch in (("smooth running", found.smooth), ("stick-slip", found.sticking)) if branch[-1].regime != SMOOTH
        ]
        if late or lasting:
            words = [f"{name} at {border.value:.5g} +- {border.tolerance:.2g} {found.unit}" for name, border in late]
            words += [f"begun from {name} the machine is not smooth even at {bounds[1]:g} {found.unit}" for name in lasting]
            self._fail(
                "onset_below",
                f"Stick-slip over `{parameter}` must end below {limit:g} {found.unit}, but {', and '.join(words)}.\n{found}",
                found.plot,
            )
        return found

    def robust(
        self,
        loop: ClosedLoop,
        *,
        disk_margin: float | None = None,
        peak_sensitivity: float | None = None,
        gain: tuple[float, float] | None = None,
        delay: float | None = None,
        **arguments: Any,
    ) -> Margins:
        """Assert that the loop at steady running has at least the given margins, with its sampling, hold and delay, and return its margins.

        - disk_margin [1]: at least so much, of all commands together;
        - peak_sensitivity [1]: at most so much;
        - gain: (low, high), factors of each command that it bears;
        - delay [s]: more, that it bears;
        - loop, arguments: as in `toolbox.margins`.

        A law without a linear loop is judged by what is measured on the machine: it has a gain and a delay, but neither a disk margin nor a sensitivity.
        """
        __tracebackhide__ = True
        if disk_margin is None and peak_sensitivity is None and gain is None and delay is None:
            raise SceneError("Something must be asked of the loop: `disk_margin`, `peak_sensitivity`, `gain` or `delay`.")
        found = margins(loop, **arguments)
        rows: Sequence[Any] = (
            found.loop_margins if found.linear_loop is not None or found.simulated_margins is None else [found.simulated_margins]
        )
        borne = found.delay_margin if found.linear_loop is not None or found.simulated_margins is None else found.simulated_margins.delay
        low, high = max(row.lowest_gain for row in rows), min(row.highest_gain for row in rows)
        wrong = []
        if disk_margin is not None and not found.disk_margin >= disk_margin:
            wrong.append(f"the disk margin must be >= {disk_margin:g}, but it is {found.disk_margin:.3g}")
        if peak_sensitivity is not None and not found.peak_sensitivity <= peak_sensitivity:
            wrong.append(f"the peak sensitivity must be <= {peak_sensitivity:g}, but it is {found.peak_sensitivity:.3g}")
        if gain is not None and not (low <= gain[0] and high >= gain[1]):
            wrong.append(f"the loop must bear gains from {gain[0]:g} to {gain[1]:g}, but it bears {low:.3g} to {high:.3g}")
        if delay is not None and not borne >= delay:
            wrong.append(f"the loop must bear {delay:g} s more of delay, but it bears {borne:.3g} s")
        if wrong:
            text = "; ".join(wrong)
            self._fail("robust", f"{text[0].upper()}{text[1:]}.\n{found}", found.plot)
        return found

    def survives(self, loop: ClosedLoop, duration: float, **arguments: Any) -> WorstCase:
        """With every model error, from every start and with every seed the law ends free, at its speed and calm; returns the worst case.

        The arguments are those of `toolbox.worst_case`.
        """
        __tracebackhide__ = True
        found = worst_case(loop, duration, **arguments)
        if not found.survives:
            self._fail("survives", f"Every run must end free, at its speed and calm, but not all do.\n{found}", found.plot)
        return found

    def beats(
        self, run: Trajectory, other: Trajectory, after: float, signal: str | None = None, element: str | None = None, by: float = 1.0
    ) -> float:
        """A run sticks no longer than another and its severity is below that of the other, divided by `by`; returns the ratio of severities."""
        __tracebackhide__ = True
        contact = judged_contact(run.program.system, element)
        signal = signal or judged_speed(run.run.loop, contact)
        mine, theirs = (measure.severity(each, signal, after) for each in (run, other))
        stuck, stuck_other = (stick_time(each, contact, after) for each in (run, other))
        if not (stuck <= stuck_other and mine < theirs / by):
            asked = f" by a factor of {by:g}" if by != 1.0 else ""

            def both() -> Any:
                from toolbox.simulation.plot import comparison

                return comparison({"this": run, "the other": other}, signal, contact)

            self._fail(
                "beats",
                f"The run must beat the other after {after:g} s{asked}, but the severity of `{signal}` is {mine:.4g} against {theirs:.4g}, and "
                f"`{contact}` sticks {stuck:.4g} s against {stuck_other:.4g} s",
                both,
            )
        return mine / theirs if theirs else math.nan

    def _fail(self, check: str, text: str, draw: Callable[[], Any]) -> None:
        __tracebackhide__ = True
        raise AssertionError(f"{text.rstrip('.')}.\n{self._figure(check, text, draw)}")

    def _figure(self, check: str, text: str, draw: Callable[[], Any]) -> str:
        """Save the figure of a failure and say where; a figure that cannot be drawn must not hide what failed."""
        path = self.folder / f"{re.sub(r'[^A-Za-z0-9]+', '_', self.name).strip('_')}_{check}.png"
        try:
            import matplotlib

            matplotlib.use("Agg")  # a test has no screen
            import matplotlib.pyplot as plt

            self.folder.mkdir(parents=True, exist_ok=True)
            figure = np.ravel(draw())[0].figure
            figure.suptitle(f"{self.name}: {check}", fontsize=9.0)
            figure.savefig(path, dpi=150)
            plt.close(figure)
        except Exception as error:
            return f"(There is no figure: {error})"
        return f"Figure: {path}"


def _with_limits(run: Trajectory, signal: str, ends: tuple[float, float]) -> Any:
    """A picture of a signal with the limits that it has to keep, and the first axes with room for them."""
    axes = np.ravel(run.plot(signal))
    finite = [end for end in ends if math.isfinite(end)]
    for k, end in enumerate(finite):
        axes[0].axhline(end, color="black", linewidth=1.0, linestyle=":", label="limit" if k == 0 else None)
    low, high = axes[0].get_ylim()
    room = 0.05 * (max(high, *finite) - min(low, *finite))
    axes[0].set_ylim(min([low, *(end - room for end in finite)]), max([high, *(end + room for end in finite)]))
    axes[0].legend(frameon=False, loc="upper right")
    return axes
