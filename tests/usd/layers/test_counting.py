"""Stages without end, or too deep, are refused before OpenUSD composes them, which would end the process."""

import resource
import struct
from zipfile import ZipFile

import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.common.openusd import Sdf, UsdUtils
from photonbeams.usd.layers.counting import is_deep
from photonbeams.usd.stage import open_stage


def nested(depth, inner="", options=""):
    """Return prims in prims, the last of which has an inner part and options."""
    return 'def "a" {\n' * (depth - 1) + f'def "a" ({options}) {{ {inner} }}\n' + "}\n" * (depth - 1)


def refusal(path, **options):
    with pytest.raises(SceneError) as error:
        open_stage(path, **options)
    return str(error.value)


@pytest.mark.parametrize(
    "arc", ["subLayers = [@./deep.usda@]", "references = @./deep.usda@</a>", "payload = @./deep.usda@</a>"]
)
def test_a_layer_of_braces_in_braces_is_left_out(tmp_path, arc, caplog):
    (tmp_path / "deep.usda").write_text("#usda 1.0\n" + nested(20_000))
    header, prim = (f"({arc})", "") if "subLayers" in arc else ("", f'def "World" ({arc}) {{}}')
    (tmp_path / "root.usda").write_text(f"#usda 1.0\n{header}\n{prim}")
    open_stage(tmp_path / "root.usda")
    assert "refers to ./deep.usda: expected a file, it nests braces more than 1,000 deep; it is left out" in caplog.text


def test_a_root_or_session_layer_of_braces_in_braces_is_refused(tmp_path):
    (tmp_path / "deep.usda").write_text("#usda 1.0\n" + nested(20_000))
    (tmp_path / "root.usda").write_text("#usda 1.0\n")
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "root.usda"), str(tmp_path / "good.usdz"))
    packed = tmp_path / "deep.usdz"
    with ZipFile(packed, "w") as writer:
        writer.write(tmp_path / "deep.usda", "deep.usda")
    problem = "expected a USD stage, it nests braces more than 1,000 deep"
    assert problem in refusal(tmp_path / "deep.usda")
    assert problem in refusal(packed)
    assert problem in refusal(tmp_path / "root.usda", session_layers=[tmp_path / "deep.usda"])
    open_stage(tmp_path / "good.usdz")


@pytest.mark.parametrize("options", ["references = </B>", "payload = </B>", "inherits = </B>", "specializes = </B>"])
def test_prims_in_prims_are_not_too_deep_through_references(tmp_path, options):
    (tmp_path / "a.usda").write_text(f'#usda 1.0\n{nested(600, options=options)}def "B" {{ {nested(600)} }}')
    assert "a.usda has prims in prims, more than 1,000 deep: expected fewer" in refusal(tmp_path / "a.usda")


BRANCHES = '  def "c0" ({0}) {{}}\n  def "c1" ({0}) {{}}\n'


def chain(levels, options):
    """Return prims of which each has two that refer to the next, 2^levels in all."""
    prims = (f'def "L{k}" {{\n{BRANCHES.format(options.format(f"</L{k + 1}>"))}}}\n' for k in range(levels))
    return "#usda 1.0\n" + "".join(prims) + f'def "L{levels}" {{}}\n'


@pytest.mark.parametrize(
    "options",
    ["references = {}", "payload = {}", "inherits = {}", "specializes = {}", "references = {}\ninstanceable = true"],
)
def test_prims_without_end_are_refused(tmp_path, options):
    """Two references to two references, 26 times, are 2^26 prims, and as many again below each other name."""
    (tmp_path / "a.usda").write_text(chain(26, options))
    text = refusal(tmp_path / "a.usda")
    # L0 is 2^27 - 1 prims, L1 2^26 - 1, and so on; the root is one more.
    assert f"a.usda has {2**28 - 28:,} prims" in text and "expected no more than 10,000,000" in text
    (tmp_path / "b.usda").write_text("#usda 1.0\n(subLayers = [@a.usda@])\n")
    (tmp_path / "c.usda").write_text("#usda 1.0\n")
    assert "prims, with those that it refers to" in refusal(tmp_path / "b.usda")
    assert "prims, with those that it refers to" in refusal(tmp_path / "c.usda", session_layers=[tmp_path / "a.usda"])


def test_what_is_not_selected_is_not_counted(tmp_path):
    text = chain(26, "references = {}").replace('def "L0" {', 'def "L0" (active = false) {')
    for k in range(1, 26):
        text = text.replace(f'def "L{k}" {{', f'over "L{k}" (active = false) {{')
    (tmp_path / "a.usda").write_text(text)
    assert open_stage(tmp_path / "a.usda")


def test_a_mask_selects_what_is_counted(tmp_path):
    from photonbeams.usd.common.selection import Selection

    (tmp_path / "a.usda").write_text(chain(26, "references = {}"))
    stage = open_stage(tmp_path / "a.usda", selection=Selection(mask=("/L20",)))
    assert len([*stage.GetPrimAtPath("/L20").GetChildren()]) == 2


def test_braces_in_texts_and_comments_nest_nothing():
    line = b'def "a" { string x = "}" # }\n'
    assert is_deep(line * 2000 + b"}" * 2000)
    assert not is_deep(b'string x = "{{{{"  # {\n' * 2000)
    assert not is_deep(b'def "a" { asset x = @it\'s@ }\n' * 2000)
    assert is_deep(b'string x = "`' + b"if(True," * 2000 + b"1" + b")" * 2000 + b'`"')
    assert not is_deep(b"(1, 2, 3), " * 2000)


@pytest.mark.parametrize("packed", [False, True])
def test_an_array_that_claims_more_than_memory_holds_is_left_out(tmp_path, caplog, packed):
    """OpenUSD would allocate 8.6 GB for a file of a kilobyte."""
    layer = Sdf.Layer.CreateNew(str(tmp_path / "a.usdc"))
    prim = Sdf.CreatePrimInLayer(layer, "/A")
    for name, values in (("wrong", [11, 12, 13, 14]), ("right", [21, 22, 23, 24])):
        Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.IntArray).default = values
    layer.Save()
    del prim, layer
    data, count = (tmp_path / "a.usdc").read_bytes(), struct.pack("<Q4i", 4, 11, 12, 13, 14)
    assert data.count(count) == 1
    (tmp_path / "b.usdc").write_bytes(data.replace(count, struct.pack("<Q", (1 << 31) + 1) + count[8:]))
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with ZipFile(tmp_path / "b.usdz", "w") as writer:
        writer.write(tmp_path / "b.usdc", "b.usdc")
    stage = open_stage(tmp_path / ("b.usdz" if packed else "b.usdc"))
    prim = stage.GetPrimAtPath("/A")
    assert not prim.GetAttribute("wrong") and list(prim.GetAttribute("right").Get()) == [21, 22, 23, 24]
    assert "/A.wrong claims more values than memory holds, or is damaged" in caplog.text
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
