"""`photonbeams quadrature` confirms the Talk's claim; its study integrates the same function as the renderer."""

import re

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import cli
from photonbeams.looks import Attenuation, ColorRamp, Epanechnikov, Smoothstep, Tabulated, Uniform
from photonbeams.studies import convergence

LENGTH, RADII, MEDIUM = 4.0, (0.3, 0.9), pb.Medium((0.2, 0.35, 0.6), (0.03, 0.03, 0.03))


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        cli.main(["quadrature", *map(str, arguments)])
    return stop.value.code


@pytest.mark.parametrize(
    ("across", "along"),
    [
        (Uniform(), Attenuation()),
        (Tabulated([1.0, 0.0]), Attenuation()),
        (Smoothstep(0.5), ColorRamp([0, 0.3, 1], [[1, 1, 1], [1, 0.4, 0.1], [0.1, 0.1, 0.3]]) * Attenuation()),
    ],
)
def test_the_studied_integral_is_that_of_the_frustum(across, along):
    chords = convergence.Chords.random(40, seed=1)
    (ours,) = convergence.chord_integrals(chords, across, along, [(pb.gauss_legendre(12), 1)])
    beams = pb.Beams([[0, 0, 0]], [[0, 0, LENGTH]], *RADII, [[1, 1, 1]])
    look = pb.Look(along=along, across=across, angle=1.0)
    theirs = pb.estimate(beams, chords.origin, chords.direction, look=look, medium=MEDIUM, estimator="frustum",
                         rule=pb.gauss_legendre(12)).numpy().T  # fmt: skip
    # The chords are float32, and the kernel reads profiles from a table of 1,024 entries over the square of ρ.
    np.testing.assert_allclose(theirs, ours, rtol=2e-3)
    assert np.median(np.abs(theirs / ours - 1)) < 2e-5


def test_the_study_uses_a_rule_as_the_rule_does_itself():
    chords = convergence.Chords.random(5, seed=2)
    (ours,) = convergence.chord_integrals(chords, Uniform(), pb.looks.Constant(1.0), [(pb.riemann(3), 1)])
    red = np.array(MEDIUM.extinction)[0]
    rule = pb.riemann(3).integrate(
        lambda t: np.exp(-red * t) / (np.pi * chords.radius(t) ** 2), np.zeros(5), chords.exit()
    )
    np.testing.assert_allclose(ours[0], rule, rtol=1e-6)  # the constant is a float32


def test_rays_leave_the_beam_through_its_wall_or_an_end():
    chords = convergence.Chords.random(1000, seed=3)
    end = chords.exit()
    at_wall = np.isclose(chords.from_axis(end), chords.radius(end), rtol=1e-9)
    at_end = np.isclose(chords.s(end), 0, atol=1e-9) | np.isclose(chords.s(end), LENGTH)
    assert np.all(at_wall | at_end)
    for t in (0.0 * end, 0.5 * end, (1 - 1e-9) * end):
        assert np.all((chords.from_axis(t) <= chords.radius(t)) & (chords.s(t) >= -1e-9) & (chords.s(t) <= LENGTH))


def test_gauss_converges_and_riemann_falls_as_the_square():
    curve = convergence.curves([("Epanechnikov", Epanechnikov(), Attenuation())], rays=64, max_order=16, seed=0)[0]
    assert curve.gauss[16][1] < 1e-10
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
