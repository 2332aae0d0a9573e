"""The layers of a stage: files, MaterialX documents, and the texture limit."""

import os

import numpy as np
import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.stage import open_stage, read_scene
from photonbeams.usd.textures import texture_limit
from photonbeams.usd.warnings import Warnings

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


def test_a_broken_document_is_named_and_left_out(tmp_path, caplog):
    pytest.importorskip("MaterialX")
    written(tmp_path / "m.mtlx", "<materialx><oh")
    stage = open_stage(written(tmp_path / "stage.usda", STAGE % "m.mtlx"))
    assert read_scene(stage).meshes[0].material.diffuse == (0.18, 0.18, 0.18)
    assert "m.mtlx cannot be read: expected a MaterialX document" in caplog.text


@pytest.mark.parametrize("arc", ["references = @%s@", "payload = @%s@", "inherits = </B>", "sub references = @%s@"])
def test_a_layer_that_is_no_file_is_refused_at_once(tmp_path, caplog, arc):
    pipe = tmp_path / "pipe.usda"
    os.mkfifo(pipe)
    named = arc.removeprefix("sub ").replace("%s", pipe.name)
    sub = f"(subLayers = [@{pipe.name}@])" if arc.startswith(("inherits", "sub")) else ""
    stage = written(tmp_path / "stage.usda", f'#usda 1.0\n{sub}\ndef "A" ({named}) {{\n}}\n')
    with pytest.raises(SceneError, match=r"stage\.usda refers to pipe\.usda: expected a file, it is a named pipe"):
        open_stage(stage, warnings=Warnings(strict=True))
    assert open_stage(stage).GetPrimAtPath("/A")
    assert "it is a named pipe; it is left out" in caplog.text
    with pytest.raises(SceneError, match=r"pipe\.usda cannot be read: expected a USD stage, it is a named pipe"):
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
