"""A file of edits that another program has changed is not replaced without a word: merge, or save a copy."""

import os
import re
import sys

import pytest

from photonbeams.studio import edits as editing
from photonbeams.studio.edits import ChangedError, Edits
from photonbeams.usd.authoring.editing import EditLayer
from photonbeams.usd.stage import open_stage

STAGE = '#usda 1.0\ndef SphereLight "Lamp"\n{\n}\ndef SphereLight "Other"\n{\n}\n'
INTENSITY, EXPOSURE, RADIUS = (f"/Lamp.inputs:{name}" for name in ("intensity", "exposure", "radius"))
THEIRS = """#usda 1.0
over "Lamp" {
    float inputs:intensity = 5
    float inputs:radius = 0.5
}
over "Other" {
    float inputs:intensity = 7
}
"""


@pytest.fixture
def begin(tmp_path, monkeypatch):
    """Return a function that begins edits of a stage, and returns them and a function of their values."""
    monkeypatch.setattr(editing, "SOON", 1000.0)
    (tmp_path / "shot.usda").write_text(STAGE)

    def begun():
        stage = open_stage(tmp_path / "shot.usda")
        return Edits(EditLayer(stage), tmp_path / "look.usda"), lambda path: stage.GetAttributeAtPath(path).Get()

    return begun


@pytest.fixture
def look(tmp_path):
    return tmp_path / "look.usda"


def test_a_file_that_another_program_wrote_is_not_replaced(begin, look):
    edits, _ = begin()
    edits.set({INTENSITY: 2.0})
    look.write_text(THEIRS)  # there was none before
    with pytest.raises(ChangedError, match=r"look\.usda"):
        edits.save()
    look.with_name("beside").mkdir()
    with pytest.raises(ChangedError):
        edits.save(look.with_name("beside") / ".." / look.name)
    assert look.read_text() == THEIRS
    assert not edits.is_saved
    edits, _ = begin()  # the autosave is older than the file; what the studio reads now, it may write
    edits.set({INTENSITY: 3.0})
    edits.save()
    edits.set({INTENSITY: 4.0})
    edits.save()  # nobody else has written in between


def test_a_merge_keeps_the_changes_of_both_and_can_be_undone(begin, look):
    edits, value = begin()
    edits.set({INTENSITY: 2.0, EXPOSURE: 1.0, "/Other.inputs:radius": 3.0})
    edits.save()
    edits.set({INTENSITY: 9.0, "/Other.inputs:radius": None})
    mine = edits.text()
    look.write_text(THEIRS)  # without the exposure, which was not edited here since
    edits.save(changed="merge")
    paths = (INTENSITY, EXPOSURE, RADIUS, "/Other.inputs:intensity", "/Other.inputs:radius")
    assert [value(path) for path in paths] == [9.0, 0.0, 0.5, 7.0, 0.5]  # 0 and 0.5 are what the stage has
    assert edits.is_saved
    assert open_stage(look).GetAttributeAtPath(INTENSITY).Get() == 9.0
    edits.save()
    edits.undo()
    assert edits.text() == mine


def test_new_prims_of_both_are_in_a_merge(begin, look):
    edits, _ = begin()
    edits.change(lambda layer: layer.define("/Looks/Mine", "PhotonBeamsLook"))
    look.write_text('#usda 1.0\ndef Scope "Looks" {\n    def PhotonBeamsLook "Theirs" {\n    }\n}\n')
    edits.save(changed="merge")
    merged = open_stage(look)
    found = [str(each.GetTypeName()) for each in merged.GetPrimAtPath("/Looks").GetAllChildren()]
    assert found == ["PhotonBeamsLook"] * 2


def test_a_copy_leaves_the_file_alone_and_saving_goes_on_there(begin, look):
    edits, _ = begin()
    edits.set({INTENSITY: 2.0})
    look.write_text(THEIRS)
    look.with_name("look.copy.usda").write_text("an earlier copy")
    copy = look.with_name("look.copy2.usda")
    assert edits.save(changed="copy") == edits.save() == copy
    assert look.read_text() == THEIRS
    assert open_stage(copy).GetAttributeAtPath(INTENSITY).Get() == 2.0


def test_the_stage_itself_is_never_written(begin, look):
    os.link(look.with_name("shot.usda"), look)
    with pytest.raises(editing.SceneError, match=r"look\.usda would replace .*shot\.usda"):
        begin()


def test_a_file_that_cannot_be_saved_to_is_refused_at_once(tmp_path):
    (tmp_path / "shot.usda").write_text(STAGE)
    with pytest.raises(editing.SceneError, match=r"look\.txt: expected a \.usda"):
        Edits(EditLayer(open_stage(tmp_path / "shot.usda")), tmp_path / "look.txt")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no named pipes in folders")
def test_a_pipe_is_not_waited_for(begin, look):
    edits, _ = begin()
    edits.set({INTENSITY: 2.0})
    os.mkfifo(look)
    with pytest.raises(editing.SceneError, match="it is a named pipe"):
        edits.save(changed="merge")


def test_files_have_their_place_beside_the_layer(tmp_path):
    """What another program has written beside the stage, relative to its own file, is found, and stays relative."""
    (tmp_path / "looks").mkdir()
    (tmp_path / "shot.usda").write_text(STAGE)
    look = tmp_path / "looks" / "look.usda"
    named = "asset inputs:{} = @{}@\n"
    names = ("./a.png", "../b.png", "/elsewhere/c.png", "d.png")
    (look.with_name("d.png")).touch()
    lines = "".join(named.format("abcd"[k], name) for k, name in enumerate(names))
    look.write_text(f'#usda 1.0\nover "Lamp" {{\n{lines}}}\n')
    stage = open_stage(tmp_path / "shot.usda")
    edits = Edits(EditLayer(stage), look)
    found = [stage.GetAttributeAtPath(f"/Lamp.inputs:{each}").Get().path for each in "abcd"]
    assert found == [str(tmp_path / "looks" / "a.png"), str(tmp_path / "b.png"), names[2], str(look.with_name("d.png"))]
    edits.set({INTENSITY: 2.0})
    edits.save()
    assert re.findall("@(.*)@", look.read_text()) == [*names[:3], "./d.png"]


def test_what_cannot_be_merged_is_told_and_nothing_is_changed(begin, look):
    edits, _ = begin()
    edits.set({INTENSITY: 2.0})
    before = edits.text()
    look.write_text("no layer")
    with pytest.raises(editing.SceneError, match="expected a USD layer"):
        edits.save(changed="merge")
    assert (edits.text(), look.read_text()) == (before, "no layer")


def test_restored_edits_do_not_replace_what_was_written_while_they_were_unsaved(begin, look):
    edits, _ = begin()
    edits.set({INTENSITY: 2.0})
    look.write_text(THEIRS)
    edits.close()  # writes the autosave, which is now newer than the file
    edits, value = begin()
    assert edits.restored
    with pytest.raises(ChangedError):
        edits.save()
    edits.save(changed="merge")
    assert [value(path) for path in (INTENSITY, RADIUS)] == [2.0, 0.5]


def test_what_another_program_wrote_outlasts_a_restart_where_it_was_not_edited(begin, look):
    look.write_text(THEIRS)
    edits, _ = begin()
    edits.set({EXPOSURE: 2.0, RADIUS: 3.0})
    theirs = THEIRS.replace("intensity = 5", "intensity = 999").replace("radius = 0.5", "radius = 4")
    look.write_text(theirs.replace("float inputs:intensity = 7", ""))
    for _ in range(2):  # the second studio keeps what the first one knew
        edits.close()
        edits, value = begin()
        edits.set({"/Lamp.inputs:diffuse": 0.5})
    edits.save(changed="merge")
    assert [value(path) for path in (INTENSITY, EXPOSURE, RADIUS)] == [999.0, 2.0, 3.0]
    assert value("/Other.inputs:intensity") == 1.0  # what the stage has: the other program removed it


@pytest.mark.parametrize("base", ["", ' "#usda 1', ' "\\q"', ' "no layer"'])
def test_all_values_of_an_autosave_that_does_not_tell_its_base_are_edits(begin, look, base):
    look.write_text(THEIRS)
    look.with_name("look.usda.autosave").write_text(THEIRS.replace("\n", f"\n# over 12ab{base}\n", 1).replace("7", "8"))
    edits, value = begin()
    assert edits.restored
    look.write_text(THEIRS.replace("7", "9"))
    edits.save(changed="merge")
    assert value("/Other.inputs:intensity") == 8.0
