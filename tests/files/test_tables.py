"""Tables at the border: what a file says is what is read, and every mistake is an error that names file, row, column and what would be right."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from models import DrillString, Section, Survey, read_sections, read_survey
from tests.refusals import refusals
from toolbox import SceneError
from toolbox.files.tables import Column, read

PIPE = "length [m],OD [in],ID [in],material\n"
GOOD = PIPE + "1000,5,4.276,steel\n200,6.5,2.8125,steel\n"
HOLE = "depth [m],inclination [deg],azimuth [deg]\n"


@pytest.fixture
def written(tmp_path):
    """Write text to a table and return its path."""

    def write(text, name="string.csv"):
        path = tmp_path / name
        path.write_bytes(text) if isinstance(text, bytes) else path.write_text(text, encoding="utf-8")
        return path

    return write


def test_numbers_are_read_in_the_units_of_their_headings(written):
    first, second = read_sections(written("# after the tally of yesterday\n" + GOOD))
    assert first == Section(1000.0, 0.127, 4.276 * 0.0254)
    assert (second.length, second.outer, second.inner) == (200.0, 0.1651, 0.0714375)
    assert (second.density, second.shear_modulus) == (7850.0, 79.3e9)


def test_a_diameter_may_be_a_whole_number_and_the_sign_of_a_fraction(written):
    signs, points = written(PIPE + "1000,5½,4¾,steel\n", "signs.csv"), written(PIPE + "1000,5.5,4.75,steel\n")
    assert read_sections(signs) == read_sections(points)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_semicolons_and_tabulators_part_cells_too(written, mark):
    assert read_sections(written(GOOD.replace(",", mark) + "\n\n")) == read_sections(written(GOOD, "commas.csv"))


def test_a_byte_order_mark_quotes_and_other_orders_of_columns_do_no_harm(written):
    text = '\ufeff"ID [mm]","OD [mm]","length [ft]","density [g/cm^3]","shear modulus [GPa]"\r\n100,127,"1000",7.85,79.3\r\n'
    (section,) = read_sections(written(text))
    assert section.length == pytest.approx(304.8, rel=1e-15)
    assert section.density == pytest.approx(7850.0, rel=1e-15)


def test_depths_may_stand_instead_of_lengths(written):
    text = "from [m],to [m],OD [in],ID [in],material\n0,1000,5,4.276,steel\n1000,1200,6.5,2.8125,steel\n"
    assert read_sections(written(text)) == read_sections(written(GOOD, "lengths.csv"))


def test_a_toml_table_takes_text_with_units_numbers_in_si_and_headings_with_units(written):
    text = """
    [[sections]]
    length = "1 km"
    OD = "5 in"
    "ID [in]" = 4.276
    material = "steel"

    [[sections]]
    length = 200
    OD = 0.1651
    ID = "2.8125 in"
    material = "steel"
    """
    assert read_sections(written(text, "string.toml")) == read_sections(written(GOOD))


def test_a_survey_goes_by_its_usual_short_names(written):
    text = "MD [ft],Inc [deg],Azi [deg],#TVD [ft]\n0,0,0,0\n1000,90,45,and so on\n"
    survey = read_survey(written(text))
    assert survey.depth == (0.0, pytest.approx(304.8))
    assert survey.inclination == (0.0, pytest.approx(math.pi / 2, rel=1e-15))


def test_a_diameter_may_be_written_as_on_the_pipe(written):
    assert read_sections(written(GOOD.replace("6.5", "6 1/2"))) == read_sections(written(GOOD))


def test_pipe_by_its_nominal_weight_and_collars_by_their_bore_stand_in_one_table(written):
    text = "length [m],OD [in],ID [in],nominal weight [lb/ft],material\n1000,5,,19.5,steel\n200,6.5,2.8125,,steel\n"
    assert [section.inner for section in read_sections(written(text))] == pytest.approx([4.276 * 0.0254, 2.8125 * 0.0254], rel=1e-12)


BAD_SECTIONS = {
    "OD below ID": (GOOD.replace("200,6.5", "200,2.5"), r"row 2 \(line 3\), column `ID \[in\]`.*smaller than the outer diameter"),
    "OD like ID": (GOOD.replace("4.276", "5"), r"row 1 \(line 2\), column `ID \[in\]`.*smaller than the outer diameter"),
    "negative length": (GOOD.replace("200,", "-200,"), r"row 2 \(line 3\), column `length \[m\]`.*> 0 m"),
    "zero length": (GOOD.replace("200,", "0,"), r"row 2 .*`length \[m\]`.*> 0 m"),
    "negative ID": (GOOD.replace("4.276", "-1"), r"row 1 .*`ID \[in\]`.*>= 0 m"),
    "unknown material": (GOOD.replace("2.8125,steel", "2.8125,steal"), r"row 2 .*`material`.*no material `steal`: did you mean `steel`"),
    "not a number": (GOOD.replace("1000", "long"), r"row 1 \(line 2\), column `length \[m\]`: it must be a number, but it is `long`"),
    "number with unit": (GOOD.replace("1000", "1000 m"), r"row 1 .*`length \[m\]`: it must be a number"),
    "decimal comma": (GOOD.replace(",", ";").replace("6.5", "6,5"), r"row 2 .*`OD \[in\]`: it must be a number, but it is `6,5`"),
    "nan": (GOOD.replace("4.276", "nan"), r"row 1 .*`ID \[in\]`: it must be a finite number"),
    "infinite": (GOOD.replace("4.276", "1e999"), r"row 1 .*`ID \[in\]`: it must be a finite number"),
    "empty cell": (GOOD.replace("4.276", " "), r"row 1 .*`ID \[in\]`: a row must have either `ID` or `nominal weight`"),
    "short row": (GOOD.replace(",4.276", ""), r"row 1 \(line 2\): the row must have 4 cells.* 3"),
    "blank row": (GOOD.replace("\n200", "\n\n200"), r"row 2 \(line 3\): the row must not be blank"),
    "missing unit": (GOOD.replace("OD [in]", "OD"), r"`OD` must name its unit, such as `OD \[m\]`"),
    "empty unit": (GOOD.replace("OD [in]", "OD []"), r"unit"),
    "wrong unit": (GOOD.replace("OD [in]", "OD [kg]"), r"`OD \[kg\]` must be in m"),
    "unknown unit": (GOOD.replace("OD [in]", "OD [inn]"), r"unknown unit `inn`.*`in`"),
    "missing column": (GOOD.replace("ID [in]", "#ID"), r"row 1 .*column `ID`: a row must have either `ID` or `nominal weight`"),
    "unknown column": (GOOD.replace("ID [in]", "IDD [in]"), r"unknown column `IDD \[in\]`: did you mean .*`ID`"),
    "column twice": (GOOD.replace("ID [in]", "OD [in]"), r"`OD \[in\]` is there 2 times"),
    "column in two units": (GOOD.replace("ID [in]", "OD [mm]"), r"`OD` once.*`OD \[mm\]` is there beside `OD \[in\]`"),
    "no material": (GOOD.replace("material", "name"), r"either `material` or `density` and `shear modulus`"),
    "material twice": ("length [m],OD [m],ID [m],material,density [kg/m3],shear modulus [Pa]\n1,.1,.05,steel,7850,8e10\n", r"row 1 .*either `material` or"),
    "half a material": ("length [m],OD [m],ID [m],density [kg/m3]\n1,.1,.05,7850\n", r"row 1 .*either `material` or"),
    "gap": ("from [m],to [m],OD [m],ID [m],material\n0,10,.1,.05,steel\n11,12,.1,.05,steel\n", r"row 2 .*`from \[m\]`.*10 m.*11 m: a gap"),
    "overlap": ("from [m],to [m],OD [m],ID [m],material\n0,10,.1,.05,steel\n9,12,.1,.05,steel\n", r"row 2 .*`from \[m\]`.*an overlap"),
    "decreasing depth": ("from [m],to [m],OD [m],ID [m],material\n0,10,.1,.05,steel\n10,8,.1,.05,steel\n", r"row 2 .*`to \[m\]`.*> 0 m"),
    "header only": (PIPE, "at least one row"),
    "empty file": ("", "at least one row"),
    "comments only": ("# nothing\n\n", "at least one row"),
    "not text": (b"\xff\xfe\x00", "UTF-8"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_SECTIONS)
def test_a_bad_table_of_sections_is_refused_with_file_row_and_column(written, case):
    text, words = BAD_SECTIONS[case]
    path = written(text)
    with pytest.raises(SceneError, match=words) as refused:
        read_sections(path)
    assert f"Table `{path}`" in str(refused.value)
    with pytest.raises(SceneError, match=words):
        DrillString.from_tables(path, top_inertia=2000.0)


BAD_TOML = {
    "text without unit": ('[[s]]\nlength = "10"\nOD = 0.1\nID = 0.05\nmaterial = "steel"', "row 1.*`length` must be in m"),
    "wrong unit": ('[[s]]\nlength = "10 kg"\nOD = 0.1\nID = 0.05\nmaterial = "steel"', "row 1.*`length` must be in m"),
    "a list": ('[[s]]\nlength = [10]\nOD = 0.1\nID = 0.05\nmaterial = "steel"', "row 1.*`length`"),
    "true": ('[[s]]\nlength = true\nOD = 0.1\nID = 0.05\nmaterial = "steel"', "row 1.*`length`"),
    "nan": ('[[s]]\nlength = nan\nOD = 0.1\nID = 0.05\nmaterial = "steel"', "row 1.*`length`.*finite"),
    "number for text": ("[[s]]\nlength = 1\nOD = 0.1\nID = 0.05\nmaterial = 7", "row 1, column `material`"),
    "missing in one row": (
        '[[s]]\nlength=1\nOD=0.1\nID=0.05\nmaterial="steel"\n[[s]]\nlength=1\nOD=0.1\nmaterial="steel"',
        "row 2, column `ID`: a row must have either `ID` or `nominal weight`",
    ),
    "two arrays": ("[[a]]\nlength=1\n[[b]]\nlength=1", "one array"),
    "no array": ("length = 1", "one array"),
    "not toml": ("length =", "TOML"),
    "empty": ("", "at least one row"),
}


@pytest.mark.parametrize("case", BAD_TOML)
def test_a_bad_toml_table_is_refused(written, case):
    text, words = BAD_TOML[case]
    with pytest.raises(SceneError, match=words):
        read_sections(written(text, "string.toml"))


BAD_SURVEYS = {
    "not from the top": (HOLE + "10,0,0\n20,0,0\n", r"row 1 .*`depth \[m\]`.*at 0 m"),
    "decreasing": (HOLE + "0,0,0\n20,0,0\n15,0,0\n", r"row 3 \(line 4\), column `depth \[m\]`: it must be > 20 m"),
    "twice": (HOLE + "0,0,0\n20,0,0\n20,0,0\n", r"row 3 .*`depth \[m\]`"),
    "upwards": (HOLE + "0,0,0\n20,200,0\n", r"row 2 .*`inclination \[deg\]`.*between 0 and 180 deg"),
    "negative": (HOLE + "0,0,0\n20,-1,0\n", r"row 2 .*`inclination \[deg\]`.*between 0 and 180 deg"),
    "degrees called radians": (
        HOLE.replace("inclination [deg]", "inclination [rad]") + "0,0,0\n20,60,0\n",
        r"row 2 .*`inclination \[rad\]`.*180 deg",
    ),
    "no unit of angle": (HOLE.replace("inclination [deg]", "inclination [1]") + "0,0,0\n20,60,0\n", r"`inclination \[1\]` must be in rad"),
    "one station": (HOLE + "0,0,0\n", r"row 1 .*at least two stations"),
    "turning back": (HOLE + "0,0,0\n20,180,0\n", r"row 2 .*180 deg"),
    "no azimuth": ("depth [m],inclination [deg]\n0,0\n1,0\n", r"must have a column `azimuth \[rad\]`"),
}


@pytest.mark.parametrize("case", BAD_SURVEYS)
def test_a_bad_survey_is_refused_with_file_row_and_column(written, case):
    text, words = BAD_SURVEYS[case]
    path = written(text, "hole.csv")
    with pytest.raises(SceneError, match=words) as refused:
        read_survey(path)
    assert f"Table `{path}`" in str(refused.value)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda written: read_sections(written(GOOD).with_name("strin.csv")), r"no table .*strin\.csv.*did you mean `string\.csv`"),
    (lambda written: read_sections(written(GOOD).parent), "cannot be read"),
    *[(lambda change=change: Section(**{"length": 10.0, "outer": 0.1, "inner": 0.05} | change), f"Argument `{next(iter(change))}` of Section")
     for change in [{"inner": 0.2}, {"length": -1.0}, {"length": math.nan}, {"outer": None}, {"density": 0.0}, {"shear_modulus": math.inf}]],
)  # fmt: skip


@pytest.mark.parametrize(
    ("stations", "word"),
    [
        (((0.0, 1.0), (0.0,), (0.0, 0.0)), "inclination"),
        (((0.0, 1.0), (0.0, math.nan), (0.0, 0.0)), "inclination"),
        (((0.0, -1.0), (0.0, 0.0), (0.0, 0.0)), "depth"),
        (((0.0, 1.0), (0.0, 0.0), "ab"), "azimuth"),
        ((7, (0.0, 0.0), (0.0, 0.0)), "depth"),
    ],
)
def test_a_survey_that_cannot_be_is_refused_in_python_too(stations, word):
    with pytest.raises(SceneError, match=f"Argument `{word}` of Survey"):
        Survey(*stations)


def test_plain_numbers_need_no_unit(written):
    table = read(written("ratio\n0.25\n"), [Column("ratio", "1")])
    assert table.rows[0]["ratio"] == 0.25


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_table_is_read_or_refused_but_never_crashes(written, data):
    at = data.draw(st.integers(0, len(GOOD)))
    junk = data.draw(st.text(st.sampled_from(",;\t\n\r\"'[]#.-+e0123456789nai\x00\u2028m "), max_size=8))
    name = data.draw(st.sampled_from(["string.csv", "string.toml"]))
    try:
        sections = read_sections(written(GOOD[:at] + junk + GOOD[at + data.draw(st.integers(0, 3)) :], name))
    except SceneError:
        return
    assert all(section.length > 0 and 0 <= section.inner < section.outer < math.inf for section in sections)
