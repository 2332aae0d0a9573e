"""Progress bars appear only on terminals, and show how far a render is."""

import io

from rich.console import Console

from photonbeams.runtime.bars import drawn, terminal


def test_there_is_a_bar_only_on_a_terminal(capsys):
    assert terminal() is None
    assert terminal(always=True) is not None


def test_a_bar_shows_what_is_done():
    text = io.StringIO()
    with drawn(Console(file=text, force_terminal=True, width=100)) as update:
        update(3, 8, "photon_beams, passes")
    assert "photon_beams, passes" in text.getvalue()
    assert "3/8" in text.getvalue()
