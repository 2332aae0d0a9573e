"""The layers of a stage: files, MaterialX documents, and the texture limit."""

import os
import re
import zipfile

import numpy as np
import pytest
from pxr import Sdf

from photonbeams.scene import SceneError
from photonbeams.usd.common.textures import texture_limit
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import open_stage, read_scene

DOCUMENT = """<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709">
  <nodegraph name="NG">
    <input name="strength" type="float" value="0.5" />
    <image name="picture" type="color3">
      <input name="file" type="filename" value="a.exr" />
    </image>
    <multiply name="dimmed" type="color3">
      <input name="in1" type="color3" nodename="picture" />
      <input name="in2" type="float" interfacename="strength" />
    </multiply>
    <output name="color" type="color3" nodename="dimmed" />
  </nodegraph>
  <standard_surface name="Surface" type="surfaceshader" colorspace="srgb_texture">
    <input name="base_color" type="color3" nodegraph="NG" output="color" />
    <input name="specular_roughness" type="float" value="%s" />
    <input name="emission" type="float" value="1" />
    <input name="emission_color" type="color3" value="0.5, 0.5, 0.5" />
  </standard_surface>
  <surfacematerial name="Painted" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="Surface" />
  </surfacematerial>
</materialx>
"""
STAGE = """#usda 1.0
def Scope "Looks" (references = @%s@</MaterialX/Materials>) {
}
def SphereLight "Lamp" {
}
def Plane "P" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Looks/Painted>
}
"""


def written(path, text):
    path.write_text(text)
    return path


def test_a_materialx_document_is_read(tmp_path, image, caplog):
    pytest.importorskip("MaterialX")
    pixels = [[[0.2, 0.4, 0.6], [0.8, 1, 0]]]
    os.rename(image("a.exr", pixels, "float"), tmp_path / "a.exr")
    written(tmp_path / "m.mtlx", DOCUMENT % 0.25)
    stage = written(tmp_path / "stage.usda", STAGE % "m.mtlx")
    found = read_scene(open_stage(stage)).meshes[0].material
    assert np.allclose(found.diffuse.pixels, 0.5 * np.array(pixels))
    assert found.roughness == 0.25
    assert found.emissive == pytest.approx((((0.5 + 0.055) / 1.055) ** 2.4,) * 3, abs=1e-6)
    # A second stage reads the document again, although OpenUSD caches the layer that was changed for the first stage.
    written(tmp_path / "m.mtlx", DOCUMENT % 0.125)
    assert read_scene(open_stage(stage)).meshes[0].material.roughness == 0.125
    assert (tmp_path / "stage.usda").read_text() == STAGE % "m.mtlx"
    assert not caplog.text


CUSTOM = """<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709">
  <nodedef name="ND_tinted" node="tinted">
    <input name="tint" type="color3" value="0.5, 0.25, 1" />
    <input name="part" type="float" value="0.5" />
    <output name="out" type="color3" />
  </nodedef>
  <nodegraph name="NG_tinted" nodedef="ND_tinted">
    <multiply name="m" type="color3">
      <input name="in1" type="color3" interfacename="tint" />
      <input name="in2" type="float" interfacename="part" />
    </multiply>
    <output name="out" type="color3" nodename="m" />
  </nodegraph>
  <nodegraph name="NG">
    <input name="strength" type="float" value="0.25" />
    <constant name="c" type="color3"><input name="value" type="color3" value="0.5, 0.75, 0.25" /></constant>
    <tinted name="a" type="color3"><input name="tint" type="color3" nodename="c" /></tinted>
    <tinted name="b" type="color3"><input name="part" type="float" interfacename="strength" /></tinted>
    <add name="sum" type="color3">
      <input name="in1" type="color3" nodename="a" />
      <input name="in2" type="color3" nodename="b" />
    </add>
    <output name="rough" type="float" nodename="r" />
    <multiply name="r" type="float">
      <input name="in1" type="float" interfacename="strength" />
      <input name="in2" type="float" value="2" />
    </multiply>
    <output name="color" type="color3" nodename="sum" />
  </nodegraph>
  <standard_surface name="Surface" type="surfaceshader">
    <input name="base" type="float" value="1" />
    <input name="base_color" type="color3" nodegraph="NG" output="color" />
    <input name="specular_roughness" type="float" nodegraph="NG" output="rough" />
  </standard_surface>
  <surfacematerial name="Painted" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="Surface" />
  </surfacematerial>
</materialx>
"""


def test_each_use_of_a_custom_node_has_its_own_values(tmp_path, caplog):
    pytest.importorskip("MaterialX")
    written(tmp_path / "m.mtlx", CUSTOM)
    found = read_scene(open_stage(written(tmp_path / "stage.usda", STAGE % "m.mtlx"))).meshes[0].material
    assert found.diffuse == pytest.approx((0.25 + 0.125, 0.375 + 0.0625, 0.125 + 0.25))
    assert found.roughness == 0.5
    assert not caplog.text


def test_a_broken_document_is_named_and_left_out(tmp_path, caplog):
    pytest.importorskip("MaterialX")
    written(tmp_path / "m.mtlx", "<materialx><oh")
    stage = open_stage(written(tmp_path / "stage.usda", STAGE % "m.mtlx"))
    assert read_scene(stage).meshes[0].material.diffuse == (0.18, 0.18, 0.18)
    assert "m.mtlx cannot be read: expected a MaterialX document" in caplog.text


ARCS = (
    "references = @%s@",
    "payload = @%s@",
    "references = @%s:SDF_FORMAT_ARGS:target=usd@",
    'references = @`"${NAME}.usda"`@',
    "inherits = </B>",
    "sub references = @%s@",
)


@pytest.mark.parametrize("arc", ARCS)
def test_a_layer_that_is_no_file_is_refused_at_once(tmp_path, caplog, arc):
    pipe = tmp_path / "pipe.usda"
    os.mkfifo(pipe)
    named = arc.removeprefix("sub ").replace("%s", pipe.name)
    sub = f"subLayers = [@{pipe.name}@]" if arc.startswith(("inherits", "sub")) else ""
    head = f'(\nexpressionVariables = {{ string NAME = "pipe" }}\n{sub}\n)'
    stage = written(tmp_path / "stage.usda", f'#usda 1.0\n{head}\ndef "A" ({named}) {{\n}}\n')
    with pytest.raises(SceneError, match=r"stage\.usda refers to \S+"):
        open_stage(stage, warnings=Warnings(strict=True))
    assert open_stage(stage).GetPrimAtPath("/A")
    assert "it is a named pipe; it is left out" in caplog.text
    with pytest.raises(SceneError, match=r"pipe\.usda cannot be read"):
        open_stage(pipe)


def test_the_texture_limit_bounds_textures(usd, image, tmp_path, caplog):
    path = image("a.png", np.full((2, 8, 3), 0.5))
    text = f"""#usda 1.0
def RectLight "L" {{
    asset inputs:texture:file = @{path}@
}}
def Plane "P" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </M>
}}
def Material "M" {{
    token outputs:surface.connect = </M/S.outputs:surface>
    def Shader "S" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>
        color3f inputs:emissiveColor.connect = </M/T.outputs:rgb>
        token outputs:surface
    }}
    def Shader "T" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{path}@
        float3 outputs:rgb
    }}
}}
"""
    stage = open_stage(written(tmp_path / "stage.usda", text), texture_limit=4)
    assert texture_limit(stage) == 4
    read_scene(stage)
    (record,) = caplog.records  # the limit is twice as high for images of lights
    expected = "/M/T.inputs:file names a.png of 8 x 2 pixels: it is scaled down to 4 x 1, as the texture limit is 4"
    assert expected in record.getMessage()


def test_a_text_that_is_too_long_is_left_out(tmp_path, caplog):
    with open(tmp_path / "huge.usda", "wb") as file:
        file.truncate(1 << 40)
    stage = written(tmp_path / "stage.usda", '#usda 1.0\n(subLayers = [@huge.usda@])\ndef "A" {\n}\n')
    assert open_stage(stage).GetPrimAtPath("/A")
    assert "huge.usda: expected a file, it has 1,024 GiB: expected up to 4 GiB; it is left out" in caplog.text


@pytest.mark.parametrize("inner", ["a\xf5.usda", "\xf5\xff.png"])
def test_a_package_with_names_that_are_no_text_is_left_out(tmp_path, caplog, inner):
    with zipfile.ZipFile(tmp_path / "p.usdz", "w") as package:
        package.writestr("x" * len(inner.encode("latin-1")), "#usda 1.0\n")
    data = (tmp_path / "p.usdz").read_bytes()
    (tmp_path / "p.usdz").write_bytes(data.replace(b"x" * len(inner), inner.encode("latin-1")))
    stage = written(tmp_path / "stage.usda", '#usda 1.0\ndef "A" (references = @p.usdz@) {\n}\n')
    assert open_stage(stage).GetPrimAtPath("/A")
    assert "stage.usda refers to p.usdz: expected a file, it holds " in caplog.text
    with pytest.raises(SceneError, match=r"p\.usdz cannot be read: expected a USD stage, it holds .* names in UTF-8"):
        open_stage(str(tmp_path / "p.usdz"))


def clips(tmp_path, text, x="double x"):
    """Return a stage over a layer whose prim /A, in a variant, has these value clips."""
    written(tmp_path / "clip.usda", '#usda 1.0\ndef "A" {\ndouble x.timeSamples = {0: 1, 2: 2}\n}\n')
    variant = f'variantSet "v" = {{\n"v" (clips = {{ dictionary c = {{\n{text}\n}} }}) {{\n{x}\n}}\n}}'
    head = '(variants = { string v = "v" }\nprepend variantSets = "v")'
    written(tmp_path / "base.usda", f'#usda 1.0\ndef "A" {head} {{\n{variant}\n}}\n')
    return written(tmp_path / "stage.usda", "#usda 1.0\n(subLayers = [@base.usda@])\n")


LISTED = 'string primPath = "/A"\nasset[] assetPaths = [@%s@]\ndouble2[] active = [(0, 0)]\n' + (
    "asset manifestAssetPath = @%s@"
)
ACTIVE = 'string primPath = "/A"\nasset[] assetPaths = [@clip.usda@]\ndouble2[] active = [%s]'
TEMPLATE = 'string primPath = "/A"\nstring templateAssetPath = "./%s"\ndouble templateStartTime = 1\n' + (
    "double templateEndTime = %g\ndouble templateStride = 1"
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (LISTED % ("pipe.1.usda", "clip.usda"), "one of them pipe.1.usda: expected a file, it is a named pipe"),
        (LISTED % ("clip.usda", "pipe.1.usda"), "one of them pipe.1.usda: expected a file, it is a named pipe"),
        (TEMPLATE % ("pipe.##.usda", 1), "one of them pipe.1.usda: expected a file, it is a named pipe"),
        (LISTED % ("empty.usda", "clip.usda"), "one of them empty.usda: expected a file, it is empty"),
        (TEMPLATE % ("clip.#.usda", 1e9), "from 1 to 1e+09 by 1: expected 1 to 1,000,000 clips"),
        (TEMPLATE[:-1] % ("clip.#.usda", 1) + "0", "from 1 to 1 by 0: expected 1 to 1,000,000 clips"),
        (TEMPLATE % ("clip.#.usda", float("inf")), "from 1 to inf by 1: expected 1 to 1,000,000 clips"),
        (ACTIVE % "(0, nan)", "whose active has nan: expected finite numbers"),
    ],
)
def test_value_clips_that_cannot_be_read_are_left_out(tmp_path, caplog, text, problem):
    os.mkfifo(tmp_path / "pipe.1.usda")
    written(tmp_path / "empty.usda", "")
    stage = open_stage(clips(tmp_path, text))
    assert stage.GetAttributeAtPath("/A.x").GetTimeSamples() == []
    assert f"base.usda: /A{{v=v}} has the value clips 'c', {problem}; they are left out" in caplog.text
    # The clips are there again as soon as the files are: nothing was written, and layers are read again.
    os.remove(tmp_path / "pipe.1.usda")
    assert open_stage(clips(tmp_path, LISTED % ("clip.usda", "clip.usda"))).GetAttributeAtPath("/A.x").Get(1.0) == 1.5


PARTS = {
    "endless": (TEMPLATE % ("clip.#.usda", 2), "double templateEndTime = 1e11", "from 1 to 1e+11 by 1"),
    "infinite": (TEMPLATE % ("clip.#.usda", 2), "double templateStartTime = -inf", "from -inf to 2 by 1"),
    "NaN": ('string primPath = "/A"\nasset[] assetPaths = [@clip.usda@]', "double2[] active = [(0, nan)]", "has nan"),
}


@pytest.mark.parametrize("over", ["subLayers = [@base.usda@]", "references"])
@pytest.mark.parametrize("kind", PARTS)
def test_parts_of_value_clips_in_two_layers_are_left_out_before_they_meet(tmp_path, caplog, kind, over):
    weak, strong, problem = PARTS[kind]
    written(tmp_path / "clip.usda", '#usda 1.0\ndef "A" {\ndouble x.timeSamples = {0: 1, 2: 2}\n}\n')
    written(tmp_path / "base.usda", f'#usda 1.0\ndef "A" (clips = {{ dictionary c = {{\n{weak}\n}} }}) {{\n}}\n')
    head, arc = (f"({over})\n", "") if over != "references" else ("", "references = @base.usda@</A>\n")
    text = f'#usda 1.0\n{head}over "A" ({arc}clips = {{ dictionary c = {{\n{strong}\n}} }}) {{\n}}\n'
    path = written(tmp_path / "stage.usda", text)
    stage = open_stage(path)  # OpenUSD hangs, or crashes
    assert stage.GetPrimAtPath("/A")
    assert "/A has the value clips 'c', " in caplog.text and problem in caplog.text
    # The first stage is composed again when its layers are read again, and so is it if that is an error.
    with pytest.raises(SceneError, match="value clips"):
        open_stage(path, warnings=Warnings("missing"))
    assert open_stage(path).GetPrimAtPath("/A") and stage.GetPrimAtPath("/A")


def test_a_broken_value_clip_is_named(tmp_path):
    written(tmp_path / "broken.usda", "#usda 1.0\n}\n")
    listed = LISTED.rpartition("\n")[0]  # without a manifest, OpenUSD reads all clips at once
    with pytest.raises(SceneError, match=r"stage\.usda cannot be read: \S+/broken\.usda, line 2: "):
        open_stage(clips(tmp_path, listed % "broken.usda"))


def binary(path, text):
    """Write a text layer as a binary one, and return its bytes."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    layer.Export(str(path))
    return path.read_bytes()


def test_a_damaged_binary_layer_does_not_end_the_process(tmp_path, caplog):
    crate = tmp_path / "a.usdc"
    prims = "".join(f'def "{name}" {{\n}}\n' for name in "ABCDE")
    data = binary(crate, f"#usda 1.0\n{prims}")
    # The root's children: five numbers of tokens. The first becomes token 0, ";-)", which is no name of a prim.
    damaged, count = re.subn(rb"(\x05\0{7})(.\0\0\0)(?=.\0\0\0)", rb"\1\0\0\0\0", data, flags=re.DOTALL)
    assert count == 1 and damaged != data
    crate.write_bytes(damaged)
    with pytest.raises(SceneError, match=r"a\.usdc is damaged: it lists prims that it does not hold"):
        open_stage(crate)
    stage = written(tmp_path / "stage.usda", '#usda 1.0\n(subLayers = [@a.usdc@])\ndef "C" {\n}\n')
    assert open_stage(stage).GetPrimAtPath("/C")
    assert "stage.usda refers to a.usdc: " in caplog.text
    assert "it lists prims that it does not hold; it is left out" in caplog.text


def test_a_layer_with_a_type_whose_name_is_no_text_is_refused(tmp_path):
    crate = tmp_path / "a.usdc"
    data = binary(crate, '#usda 1.0\ndef Oddities "A" {\n    float photonbeams:x = 1\n}\n')
    assert data.count(b"Oddities") == 1
    crate.write_bytes(data.replace(b"Oddities", b"Odd\xe7ties"))
    with pytest.raises(SceneError, match=r"a\.usdc has the text 'Odd.ties': expected UTF-8"):
        open_stage(crate)
