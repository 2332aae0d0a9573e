"""`photonbeams dress` writes a layer that renders, and says what is in it; wrong arguments write nothing."""

import pytest

from photonbeams.cli import main
from tests.helpers.windows import stage_text

pytestmark = pytest.mark.usefixtures("helping_thread")


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    (tmp_path / "export.usda").write_text(stage_text())
    monkeypatch.chdir(tmp_path)

    def called(*words):
        with pytest.raises(SystemExit) as ending:
            main([*words])
        return ending.value.code or 0, capsys.readouterr().err

    return called


def test_a_dressed_export_renders_and_overwrites_an_older_layer(call, tmp_path):
    (tmp_path / "shot.usda").write_text("#usda 1.0\n")
    before = (tmp_path / "export.usda").read_bytes()
    code, said = call("dress", "export.usda", "-o", "shot.usda")
    assert code == 0
    assert said.splitlines()[0] == "wrote shot.usda, over export.usda:"
    assert "  /Lights/Sun: a light group, a look, 3 portals" in said.splitlines()
    assert (tmp_path / "export.usda").read_bytes() == before
    code, _ = call("render", "shot.usda", "-o", "shot.exr", "--res", "32", "0", "--passes", "1", "--beams", "64", "-q")
    assert code == 0 and (tmp_path / "shot.exr").exists()
    assert call("dress", "shot.usda", "-o", "new/again.usda", "-q") == (0, "")
    assert "@../shot.usda@" in (tmp_path / "new" / "again.usda").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("export.usda", "-o", "export.usda"), "export.usda would replace "),
        (("export.usda", "-o", "shot.usdc"), "--output is shot.usdc: expected a name that ends in .usda"),
        (("export.usda", "-o", "shot.usda", "-cam", "No"), "has no camera 'No': expected one of /Camera"),
        (("none.usda", "-o", "shot.usda"), "none.usda: expected a USD stage, but there is no such file"),
    ],
)
def test_wrong_arguments_write_nothing(call, tmp_path, words, message):
    before = (tmp_path / "export.usda").read_bytes()
    code, said = call("dress", *words)
    assert code != 0 and message in said
    assert (tmp_path / "export.usda").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["export.usda"]
