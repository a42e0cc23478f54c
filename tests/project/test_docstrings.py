"""Docstrings of what is public: every function has an example that runs, describes its parameters where they stand, and begins with a verb."""

import ast
import doctest
import inspect
import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.public import PUBLIC, docstring

ROOT = Path(__file__).parents[2]
CLASSES_WITHOUT_EXAMPLE = 0
"""Public classes whose docstring has no example: a number that may only fall."""

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")

FUNCTIONS = {name: thing for name, thing in PUBLIC.items() if inspect.isfunction(thing)}
CLASSES = {name: thing for name, thing in PUBLIC.items() if inspect.isclass(thing)}


def section(text, name):
    found = re.search(rf"^{name}\n-+\n(.*?)(?=\n\n[A-Z][A-Za-z ]+\n---|\Z)", text, re.DOTALL | re.MULTILINE)
    return "" if found is None else found[1]


def examples(text):
    return doctest.DocTestParser().get_examples(section(text, "Examples"))


class Near(doctest.OutputChecker):
    """The same words, and numbers within one of the last digit shown: no example rests on the last bit of a processor."""

    def check_output(self, want, got, optionflags):
        words = [" ".join(NUMBER.sub("#", text).split()) for text in (want, got)]
        if words[0] != words[1]:
            return super().check_output(want, got, optionflags)
        pairs = zip(NUMBER.findall(want), NUMBER.findall(got), strict=True)
        return all(abs(float(told) - float(came)) <= 1.01 * last_digit(told) for told, came in pairs)


def last_digit(text):
    """The unit of the last digit of a written number; an integer is exact."""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if "." in mantissa or exponent else 0.0


def test_the_checker_of_examples_takes_the_last_digit_and_no_more():
    near = Near().check_output
    assert near("0.42 rad/s\n", "0.43 rad/s\n", 0) and not near("0.42 rad/s\n", "0.44 rad/s\n", 0)
    assert near("2e-03\n", "0.003\n", 0) and not near("2 events\n", "3 events\n", 0) and not near("2 events\n", "2 sticks\n", 0)


def test_the_faces_are_walked():
    assert len(FUNCTIONS) > 130 and len(CLASSES) > 180
    assert {"toolbox.simulation.simulate.simulate", "toolbox.measuring.measure.severity", "models.survey.read_survey"} <= FUNCTIONS.keys()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_has_an_example_that_prints_a_number_or_a_table(name):
    found = examples(docstring(FUNCTIONS[name]))
    assert found, f"{name} needs a section Examples"
    assert any(NUMBER.search(example.want) or example.want.strip() in ("True", "False") for example in found), (
        f"{name}: the example prints no number"
    )


def test_public_classes_without_an_example_become_fewer():
    without = [name for name, thing in CLASSES.items() if not examples(docstring(thing))]
    assert len(without) <= CLASSES_WITHOUT_EXAMPLE, f"{len(without)} classes: give the new ones an example: {', '.join(without)}"


@pytest.mark.parametrize("name", [name for name, thing in PUBLIC.items() if examples(docstring(thing))])
def test_an_example_of_a_docstring_runs_and_prints_what_it_shows(name, tmp_path, monkeypatch, capsys):
    """In a folder of its own. The plants of the examples are few: their machine code, made once, serves all of them."""
    if name.startswith("models.elastic"):
        pytest.importorskip("skfem")
    monkeypatch.chdir(tmp_path)
    thing = PUBLIC[name]
    test = doctest.DocTest(examples(docstring(thing)), {"__name__": "example"}, name, inspect.getsourcefile(thing), 0, None)
    heard = []
    with capsys.disabled():
        result = doctest.DocTestRunner(checker=Near(), verbose=False).run(test, out=heard.append)
    assert result.failed == 0, "".join(heard)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_describes_its_parameters_where_they_stand(name):
    text, own = docstring(FUNCTIONS[name]), set(inspect.signature(FUNCTIONS[name]).parameters) - {"former_names", "former_positional"}
    heads = [line for line in section(text, "Parameters").splitlines() if line[:1].strip()]
    assert own <= {word for line in heads for word in line.split(", ")}, f"{name} does not describe all of {sorted(own)}"
    elsewhere = re.search(r"^    As (in|of) `.*", section(text, "Parameters") + "\n" + section(text, "Raises"), re.MULTILINE)
    assert elsewhere is None, f"{name}: say it here: {elsewhere[0].strip()}"
    returned = inspect.signature(FUNCTIONS[name]).return_annotation
    assert returned in ("None", "NoReturn", None) or section(text, "Returns"), f"{name} does not say what it returns"


def described(text):
    """{parameter: its description} in the section Parameters of a docstring."""
    found, heads = {}, []
    for line in section(text, "Parameters").splitlines():
        heads = [head.strip(" *") for head in line.split(",")] if line[:1].strip() else heads
        for head in heads:
            found[head] = found.get(head, "") + line + "\n"
    return found


def documented():
    """{name: public function, or public method with a docstring of its own}."""
    for name, thing in PUBLIC.items():
        members = (
            {"": thing} if inspect.isfunction(thing) else {f".{key}": getattr(each, "__func__", each) for key, each in vars(thing).items()}
        )
        for key, member in members.items():
            if inspect.isfunction(member) and member.__doc__ and not key.startswith("._"):
                yield f"{name}{key}", member


@pytest.mark.parametrize(("name", "function"), [pytest.param(*each, id=each[0]) for each in documented()])
def test_every_parameter_is_described_and_every_default_is_said(name, function):
    told = described(inspect.cleandoc(function.__doc__))
    given = [each for each in inspect.signature(function).parameters.values() if each.name not in ("self", "cls", *FORMER)]
    named = [each.name for each in given if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
    assert set(named) <= told.keys(), f"{name} does not describe {', '.join(each for each in named if each not in told)}"
    silent = [each.name for each in given if each.default is not each.empty and "efault" not in told[each.name]]
    assert not silent, f"{name} does not say the default of {', '.join(silent)}"


FORMER = ("former_names", "former_positional")
"""Arguments that only refuse old names."""


def row_of_docstring(function):
    """The line of its file on which the docstring of a function begins."""
    lines, first = inspect.getsourcelines(function)
    definition = ast.parse(textwrap.dedent("".join(lines))).body[0]
    return first + definition.body[0].lineno - 1


def test_the_first_line_of_a_public_function_or_method_is_a_command():
    """By the rule D401 of ruff, on what is public through the faces."""
    wrong = set()
    command = [
        sys.executable,
        "-m",
        "ruff",
        "check",
        "--isolated",
        "--select",
        "D401",
        "--output-format",
        "json",
        "toolbox",
        "models",
        "controllers",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    found = {(finding["filename"], finding["location"]["row"]) for finding in json.loads(done.stdout)}
    for name, thing in PUBLIC.items():
        members = {} if inspect.isfunction(thing) else vars(thing)
        methods = {f"{name}.{key}": getattr(member, "__func__", member) for key, member in members.items() if not key.startswith("_")}
        for each, member in ({name: thing} if inspect.isfunction(thing) else methods).items():
            function = inspect.unwrap(member) if callable(member) else member
            if inspect.isfunction(function) and function.__doc__ and (inspect.getsourcefile(function), row_of_docstring(function)) in found:
                wrong.add(each)
    functions = sorted(wrong & FUNCTIONS.keys())
    assert not functions, f"begin with a verb: {', '.join(functions)}"
    methods = sorted(wrong - FUNCTIONS.keys())
    assert len(methods) <= METHODS_WITHOUT_VERB, f"{len(methods)} methods begin without a verb: {', '.join(methods)}"


METHODS_WITHOUT_VERB = 0
"""Public methods whose docstring does not begin with a verb in the imperative: a number that may only fall."""
