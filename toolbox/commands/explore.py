"""stickslip explore: a local page on which the numbers of a scene are turned."""

from __future__ import annotations

import argparse
import contextlib
import threading
import webbrowser
from pathlib import Path
from typing import Any

from toolbox.commands.terminal import asked_otherwise, loaded, plain


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
    if not given.no_browser:
        with contextlib.suppress(webbrowser.Error):
            webbrowser.open(page.address)
    threading.Thread(target=page.warm, name="page-warm", daemon=True).start()
    page.server.serve_forever()
    return 0
