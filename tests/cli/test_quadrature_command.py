"""`photonbeams quadrature` confirms the Talk's claim, by the renderer's own integral."""

import re

import pytest

from photonbeams import cli
from photonbeams.looks import Attenuation, Epanechnikov
from photonbeams.studies import convergence


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        cli.main(["quadrature", *map(str, arguments)])
    return stop.value.code


def test_gauss_converges_and_riemann_falls_as_the_square():
    curve = convergence.curves([("Epanechnikov", Epanechnikov(), Attenuation())], rays=64, max_order=16, seed=0)[0]
    assert curve.gauss[16][1] < 1e-5  # kernels have single precision
    medians = [curve.riemann[n][0] for n in (8, 16)]
    assert medians[0] / medians[1] == pytest.approx(4, rel=0.1)
    assert curve.riemann_equal() is None or curve.riemann_equal() > 2 * 6


def test_the_command_reproduces_the_talks_claim_and_draws_it(tmp_path, capsys):
    picture = tmp_path / "made" / "errors.png"
    assert run("--rays", 32, "--max-order", 8, "--plot", picture) in (None, 0)
    found = re.sub(r"\s+", " ", capsys.readouterr().out)
    for name, *_ in (*convergence.profiles(), *convergence.falloffs()):
        assert f"{name} Gauss" in found
    points = re.search(r"takes (\d) to (\d) Gauss points and \d+ to (\d+) Riemann points", found)
    assert points, found
    assert int(points[2]) <= 6
    assert int(points[3]) > 2 * int(points[2])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in picture.parent.iterdir()] == ["errors.png"]


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--rays", 0], 2, "--rays"),
        (["--max-order", 0], 2, "--max-order"),
        (["--max-order", 257], 2, "--max-order"),
        (["--plot", "errors.tif"], 2, "expected FILE.png"),
        (["--plot", "/proc/nowhere/errors.png"], 1, "Error: /proc/nowhere/errors.png: No such file or directory"),
    ],
)
def test_bad_input_is_one_sentence(arguments, code, sentence, capsys):
    assert run(*arguments) == code
    errors = re.sub(r"[\s│]+", " ", capsys.readouterr().err)
    assert sentence in errors
    assert "Traceback" not in errors
