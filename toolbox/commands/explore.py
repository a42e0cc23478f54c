"""stickslip explore: a local page on which the numbers of a scene are turned."""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
import threading
import webbrowser
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from toolbox.commands.terminal import asked_otherwise, loaded, plain
from toolbox.files.interrupts import temporary


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip explore`."""
    page = commands.add_parser(
        "explore",
        description="Serve a page to the browser of this computer, on which every number of a scene is turned: traces, verdict with its reason, phase plane, "
        "spectrum, poles, and the working point on the map with both borders. It is served to this computer alone, only to who has the address, and ends "
        "with Ctrl-C or its terminal.",
        epilog="example: stickslip explore studies/scenes/jansen_2.toml;   at which force and speed a brake groans: "
        "stickslip explore studies/scenes/brake_stop.toml --law HeldSpeed --duration '10 s'",
    )
    page.add_argument("scene", type=Path, metavar="SCENE.toml", help="the machine and its controllers")
    asked_otherwise(page)
    page.add_argument("--duration", type=plain, metavar="T", help="of the runs, judged from their half on; that of the scene without")
    page.add_argument("--port", type=int, metavar="N", help="port that is tried first (8790); where it is taken, the next that is free")
    page.add_argument("--no-browser", action="store_true", help="print the address, and open no browser")
    page.set_defaults(action=run, words=lambda given: "the page has ended.")


def run(given: argparse.Namespace) -> int:
    """Serve the page of a scene until the process ends. Returns the exit code."""
    from toolbox.arguments import whole
    from toolbox.page.served import PORT, lasting, page_of

    port = PORT if given.port is None else whole("--port", given.port, 0, 65_535)
    scene = loaded(given)
    if given.duration is not None:
        scene = lasting(scene, given.duration)
    declared = given.law is None and given.duration is None and not given.hold  # else lines of Python would load another scene
    page = page_of(scene, str(given.scene) if declared else None, given.units, port)
    given.found = {"address": page.address}
    print(f"{page.address}\nOpen this address in a browser on this computer; Ctrl-C ends it.", flush=True)
    threading.Thread(target=page.warm, name="page-warm", daemon=True).start()
    with contextlib.ExitStack() as stack:
        if not given.no_browser:
            with contextlib.suppress(webbrowser.Error, OSError):
                webbrowser.open(stack.enter_context(leading_to(page.address)).as_uri())
        page.server.serve_forever()
    return 0


@contextlib.contextmanager
def leading_to(address: str) -> Iterator[Path]:
    """A file that only this user can read, and that leads a browser to an address. It vanishes with the block, or with the process.

    Why not the address itself: every user of a computer can read the arguments of its processes, and the address holds the token of the page.
    """
    with temporary(Path(tempfile.gettempdir()) / "stickslip") as folder:
        folder.mkdir(mode=0o700)
        file = folder / "explore.html"
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as page:
            page.write(
                f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={escape(address)}"><title>stickslip explore</title>\n'
            )
        yield file
