"""What is sent again after an edit."""

import numpy as np

from photonbeams.blender.extension.changes import Sent


def prim(path, value=1.0):
    return {"path": path, "type": "Mesh", "values": {"points": ["point3f[]", np.full((2, 3), value, np.float32)]}}


def test_a_scene_is_sent_whole_at_first_even_an_empty_one():
    assert Sent().changes([]) == {"prims": [], "whole": True}


def test_what_changed_is_sent_with_what_is_below_it():
    sent = Sent()
    sent.changes([prim("/A"), prim("/A/B"), prim("/AB"), prim("/C")])
    assert sent.changes([prim("/A"), prim("/A/B"), prim("/AB"), prim("/C")]) == {}
    found = sent.changes([prim("/A", 2.0), prim("/A/B"), prim("/AB")])
    assert [each["path"] for each in found["prims"]] == ["/A", "/A/B"] and found["removed"] == ["/C"]
    assert sent.changes([prim("/A", 2.0), prim("/A/B"), prim("/AB")]) == {}


def test_an_array_of_another_type_or_shape_is_a_change():
    for other in (np.ones((2, 3)), np.ones((1, 3), np.float32), [[1.0] * 3] * 2):
        sent = Sent()
        sent.changes([prim("/A")])
        changed = prim("/A")
        changed["values"]["points"][1] = other
        assert sent.changes([changed])["prims"] == [changed]
