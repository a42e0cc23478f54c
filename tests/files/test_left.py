"""What is called like the leavings of a command that was killed is obeyed only where it is just that, and never keeps anybody from writing."""

from __future__ import annotations

import itertools
import json
import logging
import os
import random
import stat

import pytest

from toolbox.files.atomic import clear_left, replaced, replaced_folder, whole_folder

posix = pytest.mark.skipif(os.name != "posix", reason="links, pipes and owners are those of POSIX")
SOMEBODY = 12_345


def content(folder):
    """{path: what stands there} of all that is in a folder, planted names left out; links are not followed."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if not any(part.startswith(".") for part in path.relative_to(folder).parts):
            found[str(path.relative_to(folder))] = os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else None
    return found


def note(shelter, names, draw):
    """A note that names files, with numbers that are right, wrong or missing, as one writes who means harm."""
    files = {}
    for name in names:
        place = shelter.parent / name
        files[name] = place.lstat().st_ino if draw.random() < 0.7 and os.path.lexists(place) else draw.randrange(10**6)
    number = shelter.stat().st_ino if draw.random() < 0.7 else draw.randrange(10**6)
    text = json.dumps(draw.choice(({"folder": number, "files": files}, {"folder": number, "files": names}, names, {"files": files})))
    (shelter / "names").write_text(text)


def planted(folder, outside, draw):
    """Put one thing into a folder that is called like what a killed command leaves."""
    digits = f"{draw.randrange(16**16):016x}"
    shelter = folder / draw.choice((f".stickslip-{digits}", f".stickslip-{digits}", f".table.csv.{digits}.part", f"...{digits}.part"))
    kind = draw.randrange(8)
    if kind == 0:
        shelter.symlink_to(draw.choice((outside, outside / "thesis.tex", folder / "table.csv", outside / "nothing")))
        return
    if kind == 1:
        os.mkfifo(shelter)
        return
    shelter.mkdir(mode=0o700)
    for name in ("new", "old", "gone"):
        how = draw.randrange(5)
        if how == 0:
            (shelter / name).symlink_to(draw.choice((outside, folder, "..")))
        elif how == 1:
            (shelter / name).write_text("planted")
        elif how in (2, 3):
            (shelter / name).mkdir()
            for inner in draw.sample(["table.csv", "mine.txt", "thesis.tex"], draw.randrange(4)):
                if draw.random() < 0.5:
                    (shelter / name / inner).symlink_to(outside / "thesis.tex")
                else:
                    (shelter / name / inner).write_text("planted")
    if kind == 2:
        (shelter / "names").symlink_to(outside / "thesis.tex")
    elif kind == 3:
        (shelter / "names").write_bytes(draw.choice((b"", b"\xff\x00", b"[" * 100_000, b"3", b"null", b'{"files": 3}')))
    elif kind == 4:
        os.mkfifo(shelter / "names")
    elif kind == 5:
        (shelter / "mine.txt").symlink_to(outside)
    else:
        names = ["table.csv", "mine.txt", "../home/thesis.tex", str(outside / "thesis.tex"), "..", ".", "", "sub/x", "\0"]
        with_places = draw.sample(names, draw.randrange(1, 5))
        note(shelter, [name for name in with_places if "\0" not in name], draw)
    if draw.randrange(4) == 0 and os.geteuid() == 0:
        os.chown(shelter, SOMEBODY, SOMEBODY)


@posix
@pytest.mark.parametrize("seed", range(10))
def test_twenty_planted_folders_change_nothing_outside_of_them_and_refuse_no_write(tmp_path, seed):
    draw = random.Random(seed)
    for number in range(20):
        folder, outside = tmp_path / f"{number}" / "work", tmp_path / f"{number}" / "home"
        for each, names in ((folder, ("table.csv", "mine.txt")), (outside, ("thesis.tex", "data.csv"))):
            each.mkdir(parents=True)
            for name in names:
                (each / name).write_text(f"mine: {name}")
        (folder / "sub").mkdir()
        (folder / "sub" / "x").write_text("mine")
        before = content(folder), content(outside)
        allowed = {"thesis.tex", "table.csv", "mine.txt"} - {path.name for path in folder.iterdir()}
        planted(folder, outside, draw)
        with replaced(folder / "one.txt") as file:
            file.write(b"one")
        with replaced_folder(folder / "two") as new:
            new.mkdir()
        with whole_folder(folder, ["three.txt"], lambda path: set()) as new:
            (new / "three.txt").write_text("three")
        after = content(folder)
        assert [after.pop(name) for name in ("one.txt", "two", "three.txt")] == [b"one", None, b"three"], number
        came = {
            name: after[name] for name in set(after) & allowed - set(before[0])
        }  # what comes back where there was nothing hides nothing
        assert {name: value for name, value in after.items() if name not in came} == before[0], number
        assert content(outside) == before[1], number


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only root can give files away")
def test_what_another_user_has_left_stays(tmp_path, caplog):
    theirs = tmp_path / ".stickslip-0123456789abcdef"
    (theirs / "old").mkdir(parents=True)
    (theirs / "old" / "table.csv").write_text("theirs")
    (tmp_path / ".one.txt.0123456789abcdef.part").write_text("theirs")
    for path in (theirs, tmp_path / ".one.txt.0123456789abcdef.part"):
        os.chown(path, SOMEBODY, SOMEBODY)
    clear_left(tmp_path)
    assert (theirs / "old" / "table.csv").read_text() == "theirs" and len(list(tmp_path.iterdir())) == 2


@posix
def test_a_damaged_folder_is_left_alone_with_one_sentence(tmp_path, caplog):
    damaged = tmp_path / ".stickslip-0123456789abcdef"
    (damaged / "old").mkdir(parents=True)
    (damaged / "names").write_text("[")
    with caplog.at_level(logging.WARNING, logger="stickslip"):
        for _ in range(3):
            with replaced(tmp_path / "one.txt") as file:
                file.write(b"one")
    assert len(caplog.messages) == 1 and "is left alone" in caplog.messages[0] and str(damaged) in caplog.messages[0]
    assert sorted(path.name for path in damaged.iterdir()) == ["names", "old"]


@posix
@pytest.mark.parametrize("name", ["../thesis.tex", "sub/x", "..", "."])
def test_a_note_that_names_a_path_elsewhere_is_not_obeyed(tmp_path, caplog, name):
    folder = tmp_path / "work"
    left = folder / ".stickslip-0123456789abcdef"
    (left / "old").mkdir(parents=True)
    (folder / "sub").mkdir()
    (folder / "sub" / "x").write_text("mine")
    (tmp_path / "thesis.tex").write_text("mine")
    number = (folder / name).lstat().st_ino
    (left / "names").write_text(json.dumps({"folder": left.stat().st_ino, "files": {name: number}}))
    clear_left(folder)
    assert "is left alone" in caplog.text and left.is_dir()
    assert (tmp_path / "thesis.tex").read_text() == (folder / "sub" / "x").read_text() == "mine"


def dying(at, action):
    """Do something in a process that dies before its file operation of a number, as by kill -9. Returns whether it came to its end."""
    child = os.fork()
    if child == 0:
        count = itertools.count()

        def mortal(operation):
            def called(*arguments, **named):
                if next(count) == at:
                    os._exit(9)
                return operation(*arguments, **named)

            return called

        for name in ("rename", "mkdir", "rmdir", "unlink", "replace"):
            setattr(os, name, mortal(getattr(os, name)))
        code = 1
        try:
            action()
            code = 0
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 9)
    return code == 0


def results(path, word):
    """Put the results of a command into a folder, in place of those of an earlier one."""
    with whole_folder(
        path, ["table.csv", f"{word}.txt"], lambda folder: {name for name in ("table.csv", "old.txt") if (folder / name).exists()}
    ) as new:
        for name in ("table.csv", f"{word}.txt"):
            (new / name).write_text(word)


@posix
@pytest.mark.parametrize("first", range(24))
def test_a_command_killed_at_any_operation_and_its_recovery_killed_too_leave_the_old_or_the_new(tmp_path, first):
    second = 0
    while True:
        place = tmp_path / f"{second}"
        place.mkdir()
        results(place, "old")
        (place / "mine.txt").write_text("mine")
        old = content(place)
        if dying(first, lambda place=place: results(place, "new")):
            assert content(place) == {"table.csv": b"new", "new.txt": b"new", "mine.txt": b"mine"}
            return
        ended = dying(second, lambda place=place: clear_left(place))
        clear_left(place)
        assert content(place) in (old, {"table.csv": b"new", "new.txt": b"new", "mine.txt": b"mine"}), (first, second)
        assert not [path for path in place.iterdir() if path.name.startswith(".")]
        if ended:
            return
        second += 1


@posix
@pytest.mark.parametrize("at", range(14))
def test_a_command_killed_while_it_makes_the_folders_above_its_own_is_cleared_away_by_the_next(tmp_path, at):
    path = tmp_path / "a" / "b" / "out"
    dying(at, lambda: results(path, "old"))
    results(path, "new")
    assert (path / "table.csv").read_text() == "new"
    assert not [found for found in tmp_path.rglob(".*") if not stat.S_ISLNK(found.lstat().st_mode)]
