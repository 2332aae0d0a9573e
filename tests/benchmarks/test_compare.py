"""What tells two trees' pictures apart, on pictures that are made here: nothing is rendered."""

import subprocess

import numpy as np
import pytest

from benchmarks.compare import trees
from benchmarks.compare.command import report
from benchmarks.compare.comparison import Broken, Compared, Side
from benchmarks.compare.differences import (
    change,
    dots,
    dots_came,
    error,
    grey,
    line,
    normal,
    weights,
    worst_block,
)
from benchmarks.compare.page import written
from benchmarks.compare.protocol import Reply
from benchmarks.compare.tables import budget, remarks

SIZE = (96, 128)
NOISE = 0.3


def noisy(seed, seeds=2, width=1.5):
    """Return pictures (S, H, W) of light that falls off, with noise that neighbouring pixels share."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    noise = gaussian_filter(rng.normal(size=(seeds, *SIZE)), (0, width, width))
    light = np.exp(-np.linspace(0, 3, SIZE[1]))
    return light * (1 + NOISE * noise / noise.std())


def colored(pictures):
    return np.repeat(pictures[..., None], 3, axis=-1)


def side(**fields):
    about = {
        "seconds": (1.0, 1.0),
        "mean": 1.0,
        "error": 0.1,
        "dots": 0,
        "line": 2.0,
        "launches": 5,
        "kernels": 1,
        "memory": None,
    }
    return Side(**about | fields)


def compared(base=None, new=None, **fields):
    about = {"layers": ("rgba",), "unsteady": (), "change": change(noisy(1), noisy(2))}
    about["quiet"] = about["change"]
    about["worst"] = worst_block(noisy(1), noisy(2))
    return Compared("scene", base or side(), new or side(), **about | fields)


def test_a_mean_that_moved_is_noticed():
    moved = change(noisy(1), 1.25 * noisy(2))
    assert moved.z > 4
    # A spot of noise has 4 π 1.5² pixels, and a quarter of them are lit; the noise is that of two means of two seeds.
    spots = SIZE[0] * SIZE[1] / (4 * np.pi * 1.5**2) / 4
    assert moved.relative == pytest.approx(0.25, abs=4 * 1.25 * NOISE / spots**0.5)


def test_pictures_that_differ_by_noise_alone_pass():
    scores = np.array([change(noisy(2 * seed), noisy(2 * seed + 1)).z for seed in range(200)])
    assert np.abs(scores).max() < 4
    # A normal variate's standard deviation, with 200 samples' error; less, as the least significant size decides.
    assert 0.6 < scores.std() < 1 + 4 / 400**0.5


def test_noisy_parts_weigh_less_and_hide_no_change():
    base, new = noisy(1), 1.2 * noisy(2)
    for seed, pictures in enumerate((base, new), 3):
        spots = np.random.default_rng(seed).exponential(size=(2, 24, 24)) ** 2
        pictures[:, 24:48, 24:48] *= 1 + 3 * spots  # as below a lamp that few paths meet
    weight = weights(base, new)
    assert weight.mean() == pytest.approx(1)
    assert weight[30:42, 30:42].max() < weight[80:, :20].min() / 2
    assert abs(change(base, new).z) < 4 < change(weight * base, weight * new).z


def test_a_bright_spot_of_one_seed_moves_no_mean():
    lucky = noisy(2)
    lucky[0, 40, 60] += 2000
    assert abs(change(noisy(1), lucky).z) < 4


def test_what_a_whole_picture_has_in_common_is_noise():
    base, new = noisy(1), noisy(2)
    new *= np.array([1.2, 0.9])[:, None, None]  # such as the number of paths through a keyhole
    assert abs(change(base, new).z) < 4


def test_equal_paths_show_a_small_change():
    """A pair's noise cancels: a change a hundred times smaller than the noise of the mean is seen."""
    base = noisy(1)
    assert change(base, base) == (0, 0)
    new = base * (1 + 1e-4)
    new[:, ::3] *= 1 + 1e-5
    assert change(base, new).z > 4
    assert change(base, new).relative == pytest.approx(1e-4, rel=0.05)


def test_rounding_is_no_failure():
    base = noisy(1)
    assert not compared(change=change(base, base * (1 + 1e-6))).failures
    assert compared(change=change(base, base * (1 + 1e-3))).failures == ("its mean moved",)


def test_the_worst_block_is_where_light_was_added():
    base, new = noisy(1), noisy(2)
    new[:, 32:40, 64:72] *= 3
    worst = worst_block(base, new)
    assert (worst.x, worst.y) == (64, 32)
    assert worst.relative == pytest.approx(2, abs=1)
    assert worst.z > 4
    assert abs(worst_block(base, noisy(2)).z) < 5


def test_a_students_t_is_less_surprising_than_a_normal_variate():
    assert normal(-4.0, 3) == pytest.approx(-2.2, abs=0.1)
    assert normal(4.0, 1e6) == pytest.approx(4, abs=1e-3)
    assert normal(1e3, 1e6) == pytest.approx(1e3, rel=0.2)


def test_the_error_is_that_of_the_noise():
    pictures = noisy(1, seeds=64, width=8)  # blocks are smaller than the spots of the noise
    assert error(pictures) == pytest.approx(NOISE, rel=0.1)
    assert error(np.ones((2, *SIZE))) == 0


def test_planted_dots_are_counted():
    pictures = colored(noisy(1))
    assert dots(pictures) == 0
    pictures[0, 20, 30] = 100
    pictures[1, 50:52, 90:92] = 100  # as wide as a pixel filter
    pictures[1, 50, 90] = 101
    pictures[1, 0, 0] = np.nan
    assert dots(pictures) == 3


def test_edges_lines_and_lamps_are_no_dots():
    pictures = 0.01 * colored(noisy(1))
    pictures[:, 10] = 1  # a line
    pictures[:, 40:, :60] = 1  # an edge with a corner
    pictures[:, 20:26, 100:106] = 50  # a lamp
    assert dots(pictures) == 0


def test_more_dots_are_told_from_as_many():
    assert not dots_came(0, 3)
    assert dots_came(0, 4)
    assert not dots_came(100, 130)
    assert dots_came(100, 131)
    assert compared(new=side(dots=9)).failures == ("dots came",)


@pytest.mark.parametrize("column", [False, True])
def test_a_planted_line_is_found(column):
    pictures = noisy(1)
    plain = line(pictures)
    lines = pictures.swapaxes(1, 2) if column else pictures
    lines[:, 40] *= 1.3
    assert line(pictures) > 2 * plain


def test_an_edge_is_no_line():
    pictures = noisy(1)
    plain = line(pictures)
    pictures[:, 48:] *= 4
    assert line(pictures) < 2 * plain


def test_what_is_not_finite_counts_as_dark():
    pictures = np.full((1, 2, 2, 3), 3.0)
    pictures[0, 0, 0] = np.inf, np.nan, 3
    assert grey(pictures)[0] == pytest.approx(np.array([[1, 3], [3, 3]]))


def test_slower_is_beyond_the_spread_of_pairs_and_no_failure():
    assert compared(new=side(seconds=(1.3, 1.35))).slower
    assert not compared(new=side(seconds=(1.08, 1.09))).slower
    assert not compared(new=side(seconds=(1.1, 1.6))).slower
    assert not compared(new=side(seconds=(2.0, 2.0))).failures
    assert compared(new=side(seconds=(4.0, 4.0), error=0.05)).work_ratio == pytest.approx(1)


def test_a_scene_that_only_the_base_renders_fails():
    assert Broken("scene", None, "SceneError: no").failures
    assert not Broken("scene", "SceneError: no", None).failures
    assert not Broken("scene", "SceneError: no", "SceneError: no").failures
    assert remarks([], [Broken("scene", None, "SceneError: no")]) == ["scene, new: SceneError: no"]


def test_the_page_shows_pictures_side_by_side_where_bits_differ():
    pictures = colored(noisy(1)).astype(np.float32)
    results = [(compared(), (pictures, 2 * pictures)), (compared(layers=()), (pictures, pictures))]
    from benchmarks.compare.comparison import Result

    page = written([Result(*both) for both in results], "this <tree>")
    assert page.count("<img") == 4
    assert page.count(f'width="{SIZE[1]}" height="{SIZE[0]}"') == 4
    assert "this &lt;tree&gt;" in page


def test_a_reply_has_no_error_unless_it_failed():
    assert Reply().error is None


def test_a_base_that_is_no_commit_is_one_sentence(capsys):
    with pytest.raises(SystemExit) as stopped:
        report(None, ["no-such-commit"])
    assert stopped.value.code == 2
    assert "BASE is 'no-such-commit': expected a commit of this repository" in capsys.readouterr().err


def test_the_work_tree_is_removed_on_an_error(tmp_path, monkeypatch):
    def git(*arguments):
        identity = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        return subprocess.run(["git", *identity, *arguments], cwd=tmp_path, check=True, capture_output=True, text=True)

    git("init")
    (tmp_path / "file").write_text("a")
    git("add", "file")
    git("commit", "-m", "a file")
    monkeypatch.setattr(trees, "ROOT", tmp_path)
    with pytest.raises(KeyboardInterrupt), trees.work_tree(trees.commit_of("HEAD")) as tree:
        assert (tree / "file").read_text() == "a"
        raise KeyboardInterrupt
    assert not tree.exists()
    assert git("worktree", "list").stdout.count("\n") == 1


def test_the_budget_s_table_has_the_numbers_that_differ_and_all_tokens():
    base = {"looks.tokens": 100, "beams.tokens": 50, "whole.calls": 7}
    new = {"looks.tokens": 90, "beams.tokens": 50, "whole.calls": 7}
    table = budget(base, new)
    rows = list(zip(*(column._cells for column in table.columns), strict=True))
    assert rows == [
        ("looks.tokens", "100", "90", "-10"),
        ("whole.calls", "7", "7", ""),
        ("all tokens", "150", "140", "-10"),
    ]


def test_weights_are_finite_where_most_of_a_picture_is_black():
    picture = np.zeros((2, *SIZE))
    picture[:, :8, :8] = noisy(1)[:, :8, :8] * 1e6
    assert np.isfinite(weights(picture, 1.1 * picture)).all()
