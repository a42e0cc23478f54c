"""`explore` leads the browser to its page by a file that nobody else can read: its arguments, which every user can see, hold no token."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest

from toolbox.commands import explore
from toolbox.commands.command_line import main
from toolbox.page.server import Server


def test_the_argument_of_the_browser_holds_no_token_and_its_file_leads_to_the_page(tmp_path, monkeypatch, capsys):
    (tmp_path / "belt.toml").write_text('title = "belt"\nduration = 4\n[[plant]]\npart = "BlockOnBelt"\n')
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    seen = []

    def opened(address):
        path = Path(url2pathname(urlsplit(address).path))
        seen.append((address, path, path.read_text(), stat.S_IMODE(path.stat().st_mode), stat.S_IMODE(path.parent.stat().st_mode)))

    monkeypatch.setattr(explore.webbrowser, "open", opened)
    monkeypatch.setattr(explore.threading.Thread, "start", lambda thread: None)
    monkeypatch.setattr(Server, "serve_forever", Server.server_close)
    assert main(["explore", str(tmp_path / "belt.toml"), "--port", "0"]) == 0
    ((address, path, page, mode, above),) = seen
    printed = capsys.readouterr().out.split()[0]
    token = printed.rstrip("/").rpartition("/")[2]
    assert len(token) > 20 and token not in address and address.startswith("file:")
    assert re.search(r'content="0; url=([^"]+)"', page)[1] == printed
    assert os.name != "posix" or (mode, above) == (0o600, 0o700)
    assert not path.exists() and not path.parent.exists()


def test_a_browser_that_cannot_be_opened_ends_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(OSError, match="nowhere"), explore.leading_to("http://127.0.0.1:1/x/"):
        pass
