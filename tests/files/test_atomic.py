"""Files and folders take their places whole: at every operation at which a writer may die, in company of another one, and beside anything that was planted."""

from __future__ import annotations

import itertools
import os
import random
import threading

import pytest

from toolbox.errors import SceneError
from toolbox.files import atomic
from toolbox.files.atomic import replaced, replaced_folder, whole_folder

posix = pytest.mark.skipif(os.name != "posix", reason="links, pipes and forks are those of POSIX")
OPERATIONS = ("rename", "replace", "mkdir", "rmdir", "unlink", "link", "open", "scandir", "chown")


def content(folder):
    """{path: what stands there} of all that is in a folder, temporary names left out; links are not followed."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if not any(part.startswith(".") for part in path.relative_to(folder).parts):
            found[str(path.relative_to(folder))] = os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else None
    return found


def earlier(folder):
    return {name for name in ("table.csv", "old.txt", "new.txt") if (folder / name).exists()}


def results(path, word):
    """Put the results of a command into a folder, in place of those of an earlier one."""
    with whole_folder(path, ["table.csv", f"{word}.txt"], earlier) as new:
        for name in ("table.csv", f"{word}.txt"):
            (new / name).write_text(word)


def store(path, word):
    """Put a folder that is written whole in the place of an earlier one."""
    with replaced_folder(path) as new:
        new.mkdir()
        (new / "table.csv").write_text(word)


def mine(path):
    """Files of the user's beside the results."""
    (path / "sub" / "deep").mkdir(parents=True)
    (path / "sub" / "deep" / "mine.txt").write_text("mine")
    (path / "mine.txt").write_text("mine")
    (path / "link").symlink_to("mine.txt")


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

        for name in OPERATIONS:
            setattr(os, name, mortal(getattr(os, name)))
        atomic._exchanged = mortal(atomic._exchanged)
        code = 1
        try:
            action()
            code = 0
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, 9)
    return code == 0


@posix
def test_a_folder_that_is_written_whole_is_the_old_or_the_new_wherever_its_writer_dies(tmp_path):
    store(tmp_path / "store", "old")
    seen = set()
    for at in itertools.count():
        store(tmp_path / "store", "old")
        ended = dying(at, lambda: store(tmp_path / "store", "new"))
        seen.add((tmp_path / "store" / "table.csv").read_bytes())
        if ended:
            break
    assert seen == {b"old", b"new"} and at > 3


@posix
@pytest.mark.parametrize("above", [False, True], ids=["", "new folders above"])
def test_a_command_that_is_killed_at_any_operation_leaves_all_of_the_old_or_all_of_the_new(tmp_path, above):
    seen = set()
    for at in itertools.count():
        place = tmp_path / f"{at}" / "a" / "out"
        if not above:
            place.mkdir(parents=True)
            results(place, "old")
            mine(place)
        old = content(place)
        new = {name: what for name, what in old.items() if name != "old.txt"} | {"table.csv": b"new", "new.txt": b"new"}
        ended = dying(at, lambda place=place: results(place, "new"))
        found = content(place)
        assert found in (old, new), at
        seen.add(found == new)
        results(place, "new")  # beside anything that was left
        assert content(place) == new
        if ended:
            break
    assert seen == {False, True} and at > 5


def test_without_an_exchange_two_renames_put_the_new_folder_there_and_a_failing_one_brings_the_old_back(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic, "_exchanged", lambda *paths: False)
    results(tmp_path / "out", "old")
    mine(tmp_path / "out")
    before = content(tmp_path / "out")
    rename, count = os.rename, itertools.count()

    def failing(*paths):
        if next(count) == 1:
            raise OSError(5, "no")
        rename(*paths)

    with monkeypatch.context() as patch:
        patch.setattr(os, "rename", failing)
        with pytest.raises(OSError, match="no"):
            results(tmp_path / "out", "new")
    assert content(tmp_path / "out") == before
    results(tmp_path / "out", "new")
    assert content(tmp_path / "out")["table.csv"] == b"new" and content(tmp_path / "out")["sub/deep/mine.txt"] == b"mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("how", ["working directory", "no links"])
def test_where_the_folder_cannot_move_its_files_take_their_places_and_the_folder_stays(tmp_path, monkeypatch, how):
    out = tmp_path / "out"
    results(out, "old")
    mine(out)
    number = out.stat().st_ino
    if how == "working directory":
        monkeypatch.chdir(out)
    else:
        monkeypatch.setattr(os, "link", lambda *paths, **named: exec("raise OSError(1, 'no links')"))
    results(out, "new")
    assert content(out) == {
        "table.csv": b"new", "new.txt": b"new", "mine.txt": b"mine", "link": "mine.txt", "sub": None, "sub/deep": None, "sub/deep/mine.txt": b"mine",
    }  # fmt: skip
    assert out.stat().st_ino == number and not list(tmp_path.rglob(".*"))


@posix
def test_a_folder_keeps_its_rights_and_a_link_to_it_stays_one(tmp_path):
    out = tmp_path / "real"
    results(out, "old")
    mine(out)
    (out / "sub").chmod(0o750)
    out.chmod(0o770)
    (tmp_path / "out").symlink_to("real")
    results(tmp_path / "out", "new")
    assert (tmp_path / "out").is_symlink() and (out / "table.csv").read_text() == "new"
    assert [path.stat().st_mode & 0o777 for path in (out, out / "sub")] == [0o770, 0o750]


@posix
def test_what_another_process_writes_into_the_folder_meanwhile_is_there_afterwards(tmp_path, monkeypatch):
    out = tmp_path / "out"
    results(out, "old")
    mine(out)
    exchange = atomic._exchange

    def late(new, path):
        (path / "sub" / "late.txt").write_text("late")
        os.replace(path / "sub" / "late.txt", path / "mine.txt")
        (path / "sub" / "later.txt").write_text("later")
        return exchange(new, path)

    monkeypatch.setattr(atomic, "_exchange", late)
    results(out, "new")
    assert content(out) == {
        "table.csv": b"new", "new.txt": b"new", "mine.txt": b"late", "link": "mine.txt", "sub": None, "sub/later.txt": b"later", "sub/deep": None,
        "sub/deep/mine.txt": b"mine",
    }  # fmt: skip


def test_two_writers_at_once_leave_the_whole_of_one(tmp_path):
    out, faults = tmp_path / "above" / "out", []

    def write(word):
        try:
            for _ in range(30):
                with replaced(tmp_path / "file.txt") as file:
                    file.write(word.encode() * 1000)
                with replaced_folder(tmp_path / "store") as new:
                    new.mkdir()
                    (new / "a").write_text(word)
                    (new / "b").write_text(word)
        except BaseException as error:
            faults.append(error)

    threads = [threading.Thread(target=write, args=(word,)) for word in "xy"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults
    assert (tmp_path / "file.txt").read_text() in ("x" * 1000, "y" * 1000)
    assert (tmp_path / "store" / "a").read_text() == (tmp_path / "store" / "b").read_text()

    with whole_folder(out, ["table.csv", "new.txt"], earlier) as one, whole_folder(out, ["table.csv", "new.txt"], earlier) as two:
        for place, word in ((one, "one"), (two, "two")):
            for name in ("table.csv", "new.txt"):
                (place / name).write_text(word)
    assert content(out) == {"table.csv": b"one", "new.txt": b"one"}
    assert not list(tmp_path.rglob(".*"))


@posix
@pytest.mark.parametrize("seed", range(10))
def test_twenty_planted_names_change_nothing_and_stay_as_they_are(tmp_path, seed):
    draw = random.Random(seed)
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.tex").write_text("mine")
    work = tmp_path / "work"
    results(work / "out", "old")
    mine(work / "out")
    planted = {}
    for _ in range(20):
        name = draw.choice((".stickslip-{}", ".table.csv.{}.part", ".out.{}.part", "...{}.part")).format(f"{draw.randrange(16**16):016x}")
        place = draw.choice((work, work / "out")) / name
        kind = draw.randrange(4)
        if kind == 0:
            place.symlink_to(draw.choice((home, home / "thesis.tex", "..", "nothing")))
        elif kind == 1:
            os.mkfifo(place)
        elif kind == 2:
            place.write_text("planted")
        else:
            for inner in ("new", "old", "both"):
                (place / inner).mkdir(parents=True)
                (place / inner / "table.csv").write_text("planted")
                (place / inner / "thesis.tex").symlink_to(home / "thesis.tex")
            (place / "names").write_text('{"files": {"mine.txt": 3}}')
        planted[place] = place.lstat().st_mode
    results(work / "out", "new")
    with replaced(work / "one.txt") as file:
        file.write(b"one")
    assert content(home) == {"thesis.tex": b"mine"}
    assert {name: content(work)[name] for name in ("out/table.csv", "out/mine.txt", "one.txt")} == {
        "out/table.csv": b"new", "out/mine.txt": b"mine", "one.txt": b"one",
    }  # fmt: skip
    assert {place: place.lstat().st_mode for place in planted} == planted
    assert all(path in planted or any(each in path.parents for each in planted) for path in work.rglob(".*"))


def test_a_file_that_is_in_the_way_is_not_hidden(tmp_path):
    (tmp_path / "table.csv").write_text("mine")
    whole = whole_folder(tmp_path, ["table.csv"], lambda path: set())
    with pytest.raises(SceneError, match="must not hide your own files, but `.*table.csv` is not from an earlier study"), whole:
        pass
    assert (tmp_path / "table.csv").read_text() == "mine"
