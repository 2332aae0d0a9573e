"""Autosave: unsaved edits survive when the studio ends, and the saved file never changes by it."""

import logging
import os
import threading
import time

import pytest

from photonbeams.scene import SceneError
from photonbeams.studio import edits as editing
from photonbeams.studio.edits import Edits
from photonbeams.usd.authoring.editing import EditLayer
from photonbeams.usd.stage import open_stage

STAGE = """#usda 1.0
def SphereLight "Lamp"
{
}
"""
INTENSITY = "/Lamp.inputs:intensity"


@pytest.fixture
def begin(tmp_path, monkeypatch):
    """Return a function that begins edits of a stage as a studio does when it starts; the autosave's timer is off."""
    monkeypatch.setattr(editing, "SOON", 1000.0)
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    all_edits = []

    def begun(layer=tmp_path / "look.usda"):
        stage = open_stage(path)
        edits = Edits(EditLayer(stage), layer)
        edits.value = lambda: stage.GetAttributeAtPath(INTENSITY).Get()  # as the stage has it
        all_edits.append(edits)
        return edits

    yield begun
    for each in all_edits:
        each.close()


@pytest.fixture
def kept(tmp_path):
    return tmp_path / "look.usda.autosave"


def wait_for(fact):
    end = time.monotonic() + 20
    while not fact():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_edits_are_kept_soon_and_restored_and_the_file_is_as_it_was(begin, kept, tmp_path, monkeypatch, caplog):
    edits = begin()
    monkeypatch.setattr(editing, "SOON", 0.05)
    edits.set({INTENSITY: 2.0})
    saved = edits.save().read_bytes()
    edits.set({INTENSITY: 3.0})
    wait_for(lambda: kept.exists() and kept.read_text())
    assert "intensity = 3" in kept.read_text() and (tmp_path / "look.usda").read_bytes() == saved
    edits.set({INTENSITY: 4.0})
    wait_for(lambda: "intensity = 4" in kept.read_text())  # the studio is killed here

    again = begin()
    assert again.value() == 4.0 and again.restored and not again.is_saved and again.can_undo
    assert "restored" in caplog.text and str(kept) in caplog.text
    assert again.undo() and again.value() == 2.0 and again.is_saved
    assert again.redo() and again.value() == 4.0
    assert (tmp_path / "look.usda").read_bytes() == saved


def test_what_is_saved_is_not_kept(begin, kept):
    edits = begin()
    edits.set({INTENSITY: 3.0})
    edits.close()
    assert kept.exists()
    again = begin()
    assert again.restored
    again.save()
    assert not kept.exists() and not again.restored
    again.close()
    last = begin()
    assert not kept.exists() and not last.restored and last.value() == 3.0 and not last.can_undo


def test_edits_that_are_restored_can_be_given_up(begin, kept):
    edits = begin()
    edits.set({INTENSITY: 2.0})
    edits.save()
    edits.set({INTENSITY: 3.0})
    edits.close()
    again = begin()
    again.set({INTENSITY: 5.0})
    again.discard()
    assert again.value() == 2.0 and again.is_saved and not again.restored and not kept.exists()
    assert again.undo() and again.value() == 5.0  # to discard is a step like any other
    again.discard()
    again.close()
    assert not kept.exists() and not begin().restored


def test_reverting_removes_what_is_kept_and_is_kept_itself_where_the_file_says_otherwise(begin, kept):
    edits = begin()
    edits.set({INTENSITY: 2.0})
    edits.close()
    edits = begin()
    edits.revert()
    assert not kept.exists()
    edits.close()
    assert not kept.exists()  # the stage's own values are what is saved

    edits = begin()
    edits.set({INTENSITY: 2.0})
    edits.save()
    edits.revert()
    edits.close()
    again = begin()
    assert again.restored and again.paths() == [] and again.undo() and again.value() == 2.0


def test_undoing_to_what_is_saved_removes_what_was_kept(begin, kept, monkeypatch):
    edits = begin()
    monkeypatch.setattr(editing, "SOON", 0.02)
    edits.set({INTENSITY: 2.0})
    wait_for(lambda: kept.exists() and kept.read_text())
    edits.undo()
    wait_for(lambda: not kept.exists())


def test_without_a_file_nothing_is_kept(begin, tmp_path):
    before = sorted(tmp_path.iterdir())
    edits = begin(None)
    edits.set({INTENSITY: 2.0})
    edits.close()
    assert sorted(tmp_path.iterdir()) == before and not edits.restored


def test_a_file_that_was_changed_later_is_not_covered(begin, kept, caplog):
    edits = begin()
    edits.set({INTENSITY: 3.0})
    edits.close()
    kept.with_suffix("").write_text('#usda 1.0\nover "Lamp"\n{\n    float inputs:intensity = 9\n}\n')
    os.utime(kept, (1, 1))
    again = begin()
    assert again.value() == 9.0 and not again.restored and kept.exists() and "older" in caplog.text
    ignored = kept.read_text()
    again.set({INTENSITY: 5.0})
    again.close()
    assert kept.read_text() == ignored and "intensity = 5" in kept.with_name(f"{kept.name}2").read_text()


@pytest.mark.parametrize("content", [b"", b"#usda 1.0\nover {", b"\xff\xfe\x00", b"no layer at all"])
def test_an_autosave_that_cannot_be_read_is_left_out(begin, kept, content):
    kept.write_bytes(content)
    edits = begin()
    assert not edits.restored and edits.is_saved and edits.paths() == []
    edits.set({INTENSITY: 3.0})
    edits.close()
    assert begin().value() == 3.0


def test_a_name_too_long_for_an_autosave_is_told_once_and_edits_go_on(begin, tmp_path, caplog):
    edits = begin(tmp_path / f"{'l' * 245}.usda")
    with caplog.at_level(logging.WARNING, logger="photonbeams"):
        for value in (2.0, 3.0):
            edits.set({INTENSITY: value})
            edits._autosave._now()
    assert len([each for each in caplog.records if "cannot be kept" in each.getMessage()]) == 1
    assert edits.save().exists() and edits.value() == 3.0


def test_a_save_is_never_followed_by_an_autosave_of_older_edits(begin, kept, monkeypatch):
    """A save that begins while the autosave writes waits for it, and removes what the autosave wrote."""
    edits = begin()
    edits.set({INTENSITY: 2.0})
    inside, go_on = threading.Event(), threading.Event()
    written = editing.write_bytes

    def slow(path, data):
        inside.set()
        assert go_on.wait(20)
        return written(path, data)

    monkeypatch.setattr(editing, "write_bytes", slow)
    writer = threading.Thread(target=edits._autosave._now)
    writer.start()
    assert inside.wait(20)
    edits.set({INTENSITY: 3.0})  # an edit does not wait for the disk
    saver = threading.Thread(target=edits.save)
    saver.start()
    go_on.set()
    for each in (writer, saver):
        each.join(20)
    assert not kept.exists() and edits.is_saved
    again = begin()
    assert again.value() == 3.0 and not again.restored


def test_two_studios_with_one_file_have_an_autosave_each(begin, kept, caplog):
    first, second = begin(), begin()
    for edits, value in ((first, 1.0), (second, 2.0), (first, 3.0)):
        edits.set({INTENSITY: value})
        edits._autosave._now()
    other = kept.with_name(f"{kept.name}2")
    assert "intensity = 3" in kept.read_text() and "intensity = 2" in other.read_text()
    os.utime(other, (0, 0))
    assert begin().value() == 3.0 and f"{other} holds unsaved edits of another studio" in caplog.text
    second.save()
    assert kept.exists() and not other.exists()


def test_a_studio_does_not_remove_what_another_one_that_lives_keeps(begin, kept):
    first = begin()
    first.set({INTENSITY: 3.0})
    first._autosave._now()
    second = begin()
    assert second.restored and second.undo() and second.is_saved
    second.close()
    assert "intensity = 3" in kept.read_text()  # also if the first studio is killed here

    third = begin()
    third.set({INTENSITY: 4.0})
    third._autosave._now()
    first.discard()
    assert not kept.exists()
    third.close()  # its own is the second one, also without a first one
    other = kept.with_name(f"{kept.name}2")
    last = begin()
    assert last.value() == 4.0 and last.restored
    last.discard()
    assert not kept.exists() and not other.exists()


def test_unsaved_edits_whose_autosave_is_gone_are_kept_when_the_studio_ends(begin, kept):
    edits = begin()
    edits.set({INTENSITY: 3.0})
    edits._autosave._now()
    kept.unlink()
    edits.close()
    assert begin().value() == 3.0


def test_studios_that_end_at_one_moment_keep_their_edits_each(begin, kept):
    studios = [begin() for _ in range(4)]
    for number, each in enumerate(studios):
        each.set({INTENSITY: 10.0 + number})
    start = threading.Barrier(len(studios))

    def end(studio):
        start.wait()
        studio.close()

    threads = [threading.Thread(target=end, args=(each,)) for each in studios]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    found = "".join(each.read_text() for each in kept.parent.glob(f"{kept.name}*"))
    assert all(f"= {10 + number}" in found for number in range(len(studios)))


def test_an_older_autosave_is_restored_where_the_newest_cannot_be_read(begin, kept):
    edits = begin()
    edits.set({INTENSITY: 3.0})
    edits.close()
    later = kept.with_name(f"{kept.name}2")
    later.write_text("")
    os.utime(later, (time.time() + 10,) * 2)
    assert begin().value() == 3


def test_what_is_given_up_is_not_merged_over_what_another_program_wrote(begin, kept, tmp_path):
    layer, radius = tmp_path / "look.usda", "/Lamp.inputs:radius"
    edits = begin()
    edits.set({INTENSITY: 2.0})
    saved = edits.save().read_text()
    edits.set({radius: 0.2})
    edits.close()
    layer.write_text(saved.replace("= 2", "= 9"))
    os.utime(layer, (time.time() - 10,) * 2)
    edits = begin()
    assert edits.restored
    edits.discard()
    assert edits.is_saved and edits.value() == 9
    edits.set({radius: 0.5})
    layer.write_text(saved.replace("= 2", "= 11"))
    text = edits.save(changed="merge").read_text()
    assert "inputs:intensity = 11" in text and "inputs:radius = 0.5" in text


def test_undone_restored_edits_are_no_change_of_the_file(begin, tmp_path):
    layer = tmp_path / "look.usda"
    edits = begin()
    edits.set({INTENSITY: 2.0})
    saved = edits.save().read_text()
    edits.set({INTENSITY: 3.0})
    edits.close()
    layer.write_text(saved.replace("= 2", "= 9"))
    os.utime(layer, (time.time() - 10,) * 2)
    edits = begin()
    assert edits.value() == 3
    assert edits.undo() and edits.value() == 9 and edits.is_saved
    edits.set({INTENSITY: 4.0})
    assert "inputs:intensity = 4" in edits.save().read_text()


@pytest.mark.parametrize(
    "kind, value", [("uchar", 300), ("uint", -1), ("asset", "a\nb"), ("string", "\udcff"), ("half", 7e4)]
)
def test_a_value_that_its_type_does_not_have_is_refused_and_undoes_the_step(begin, tmp_path, kind, value):
    edits = begin()
    (tmp_path / "shot.usda").write_text(STAGE.replace("{\n", f"{{\n    custom {kind} own\n"))
    edits = begin(None)
    with pytest.raises(SceneError, match="expected") as caught:
        edits.set({INTENSITY: 5.0, "/Lamp.own": value})
    assert len(str(caught.value)) <= 300
    assert not edits.paths() and not edits.can_undo
