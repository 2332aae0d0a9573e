"""The page's types are those of the messages that the studio sends and accepts."""

from tools import protocol


def test_the_types_of_the_page_are_written_from_the_messages():
    assert protocol.FILE.read_text(encoding="utf-8") == protocol.written(), "run python tools/protocol.py"
