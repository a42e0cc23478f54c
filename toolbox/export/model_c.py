"""The equations of a closed system as C: the functions of `toolbox.compilation.kernel`, written by casadi, under the same one signature.

static void NAME_model_FUNCTION(double t, double h, const double *x, const double *k, const double *p, const double *m, double *y)
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.arguments import count_of
from toolbox.compilation.explicit_step import LONG, RungeKutta
from toolbox.compilation.formulas import ClosedEquations
from toolbox.compilation.program import Program
from toolbox.export.c_language import c_number
from toolbox.export.casadi_text import casadi_text

SIGNATURE = "(double t, double h, const double *x, const double *k, const double *p, const double *m, double *y)"


def model_text(name: str, program: Program, calling: str, along: Sequence[int] | None = None) -> str:
    """Return the text of all functions of a program, with the function of its signals (first the states) as `signals`, and `NAME_update`,
    which calls a sampled law by its number.

    calling: the text that calls them: what it does not call is left out.
    along: places of parameters, with which `forward` is there, too: derivatives of slopes and signals along a change k of states and of these parameters.
    """
    equations, form, formulas = program.equations, program.form, program.formulas
    assert isinstance(formulas, RungeKutta)
    symbols = [equations.t, equations.x, equations.p, equations.m]
    n = equations.x.numel()
    padded = ca.vertcat(ca.densify(form.burden), ca.SX.zeros(n - form.burden.numel()))
    made = {
        "field": equations.field,
        "project": equations.function("project", ca.densify(form.projected)),
        "probe": equations.function("probe", ca.densify(form.probed)),
        "burden": equations.function("burden", padded),
        "signals": equations.function("signals", signals_of(program)),
    }
    if form.impulse is not None:
        sticking, elastic, results = form.impulse
        made["impulse"] = ca.Function("impulse", [*symbols, ca.vertcat(sticking, elastic)], [ca.densify(results)])
    if along is not None:
        given = ca.vertcat(equations.x, *[equations.p[place] for place in along])
        seed = ca.SX.sym("seed", given.numel())
        slopes = equations.field(*symbols)[:n]
        made["forward"] = ca.Function(
            "forward", [*symbols, seed], [ca.densify(ca.jtimes(ca.vertcat(slopes, signals_of(program)), given, seed))]
        )
    for i, (z, following, outputs) in enumerate(program.updates):
        made[f"update_{i}"] = ca.Function("update", [*symbols, z], [ca.densify(ca.vertcat(following, outputs))])
    if formulas.written_out(n) and equations.rhs.n_instructions() * len(formulas.b) <= LONG:
        made["step"], step = _step(formulas, equations), ""
    else:
        made["rhs"], step = equations.rhs, _looped_step(name, formulas, n, equations.field.numel_out(0))
    always = ("rhs", *(f"update_{i}" for i in range(len(program.updates))))
    made = {word: function for word, function in made.items() if word in always or f"{name}_model_{word}(" in calling + step}
    named = {word: _renamed(function, f"{name}_casadi_{word}") for word, function in made.items()}
    wrappers = [_wrapper(name, word, function, n if word == "field" else 0) for word, function in named.items()]
    return "\n\n".join(
        [casadi_text(name, list(named.values()), given=True), *wrappers, *filter(None, [step, _updates(name, len(program.updates))])]
    )


def signals_of(program: Program) -> ca.SX:
    """The states, then the signals that are none, as one column."""
    system = program.system
    states = sum(count_of(size) for _, size, _ in system.states.values())
    wanted = [system.x[:states], *[ca.densify(value) for name, (value, _) in system.signals.items() if system.state_index(name) is None]]
    return ca.densify(program.closed(ca.vertcat(*wanted)))


def _step(formulas: RungeKutta, equations: ClosedEquations) -> ca.Function:
    """The step (t, h, x, k, p, m) -> column, written out."""
    rhs, field = equations.rhs, equations.field
    sizes = {"t": 1, "h": 1, "x": rhs.numel_in(1), "k": rhs.numel_in(1), "p": rhs.numel_in(2), "m": rhs.numel_in(3)}
    t, h, x, k, p, m = symbols = [ca.SX.sym(name, size) for name, size in sizes.items()]
    slopes = [k]

    def combined(weights: Sequence[float]) -> ca.SX:
        return h * sum((weight * slope for weight, slope in zip(weights, slopes, strict=False) if weight), ca.SX.zeros(x.numel()))

    for c, row in zip(formulas.c[1:], formulas.a[1:], strict=True):
        slopes.append(rhs(t + h * c, x + combined(row), p, m))
    new = x + combined(formulas.b)
    end = field(t + h, new, p, m)
    slopes.append(end[: x.numel()])
    errors = [combined(weights) for weights in (formulas.error, formulas.error_low) if weights]
    return ca.Function("step", symbols, [ca.densify(ca.vertcat(new, end, *errors))])


def _looped_step(name: str, formulas: RungeKutta, n: int, width: int) -> str:
    """The same in C, with loops over the states."""
    stages = len(formulas.b)

    def loop(target: str, base: str, weights: Sequence[float]) -> str:
        terms = [
            f"{c_number(weight)} * {'k' if i == 0 else f'y[{n} + i]' if i == stages else f'k{i}'}"
            for i, weight in enumerate(weights)
            if weight
        ]
        terms = [term if term.endswith("]") else f"{term}[i]" for term in terms]
        return f"  for (i = 0; i < {n}; ++i) {target}[i] = {base}h * ({' + '.join(terms)});"

    lines = [
        f"static void {name}_model_step{SIGNATURE} {{",
        f"  double stage[{n}], {', '.join(f'k{i}[{n}]' for i in range(1, stages))};",
        "  int i;",
    ]
    for i, (c, row) in enumerate(zip(formulas.c[1:], formulas.a[1:], strict=True), 1):
        lines += [loop("stage", "x[i] + ", row), f"  {name}_model_rhs(t + {c_number(c)} * h, h, stage, k, p, m, k{i});"]
    lines += [loop("y", "x[i] + ", formulas.b), f"  {name}_model_field(t + h, h, y, k, p, m, y);"]
    for place, weights in enumerate(weights for weights in (formulas.error, formulas.error_low) if weights):
        lines.append(loop(f"(y + {n + width + place * n})", "", weights))
    return "\n".join([*lines, "}"])


def _renamed(function: ca.Function, name: str) -> ca.Function:
    """A function under another name, which the C of several machines in one program needs."""
    given = [ca.SX.sym("v", function.sparsity_in(i)) for i in range(function.n_in())]
    return ca.Function(name, given, [function.call(given)[0]])


def _wrapper(name: str, word: str, function: ca.Function, offset: int) -> str:
    """A casadi function under the signature of all model code."""
    given = {4: ["&t", "x", "p", "m"], 5: ["&t", "x", "p", "m", "k"], 6: ["&t", "&h", "x", "k", "p", "m"]}[function.n_in()]
    lines = [
        f"static void {name}_model_{word}{SIGNATURE} {{",
        f"  const double *arg[{max(function.sz_arg(), 1)}];",
        f"  double *res[{max(function.sz_res(), 1)}], work[{max(function.sz_w(), 1)}];",
        f"  int places[{max(function.sz_iw(), 1)}];",
        "  (void)h; (void)x; (void)k; (void)p; (void)m;",
        *(f"  arg[{i}] = {each};" for i, each in enumerate(given)),
        f"  res[0] = y{f' + {offset}' if offset else ''};",
        f"  {function.name()}(arg, res, places, work, 0);",
        "}",
    ]
    return "\n".join(lines)


def _updates(name: str, count: int) -> str:
    """The sampled laws by their numbers."""
    if not count:
        return ""
    cases = [f"  if (law == {i + 1}) {name}_model_update_{i}(t, h, x, k, p, m, y);" for i in range(count)]
    return "\n".join([f"static void {name}_update(int64_t law, {SIGNATURE[1:]} {{", *cases, "}"])
