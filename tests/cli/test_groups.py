"""Options of commands in groups, and the flags that are made from settings."""

from dataclasses import fields, replace
from pathlib import Path

import pytest
import typer

from photonbeams.cli.flags import SettingsFlags
from photonbeams.cli.groups import Flags, option, with_groups
from photonbeams.cli.request import RenderRequest
from photonbeams.render.settings import Settings, flags

VALUES = {int: 3, float: 0.25, bool: True}


class Inner(Flags):
    loud: bool = option(False, "Be loud.")


class Outer(Flags):
    count: int | None = option(None, "A number.", "--number", "-n", kind=int, least=1, most=9)
    inner: Inner


def called(*arguments):
    """Return what a command with two groups, one in the other, gets of a command line."""
    found = []

    def command(outer: Outer, name: str = "x") -> None:
        found.append((outer, name))

    app = typer.Typer(add_completion=False)
    app.command()(with_groups(command))
    app(args=list(arguments), standalone_mode=False)
    return found[0]


def test_a_group_becomes_options_and_comes_back_as_a_record():
    assert called() == (Outer(inner=Inner()), "x")
    assert called("-n", "3", "--loud", "--name", "y") == (Outer(count=3, inner=Inner(loud=True)), "y")


def test_a_value_out_of_bounds_names_its_flag():
    with pytest.raises(typer.BadParameter, match="--number is 10: expected 1 to 9"):
        called("-n", "10")


def test_an_empty_value_is_refused_by_its_flag():
    """As of a script's variable that is not set; only the template of farms means none by an empty --camera."""
    with pytest.raises(typer.BadParameter, match=r"^--name is empty: expected a value, or no --name$"):
        called("--name", "")


def test_given_flags_are_those_that_are_not_the_default():
    assert [*Outer(inner=Inner()).given()] == []
    assert [*Outer(count=1, inner=Inner(loud=True)).given()] == ["--number", "--loud"]


@pytest.mark.parametrize(("name", "flag"), [*flags()], ids=lambda each: getattr(each, "name", each))
def test_a_flag_sets_its_setting_alone(name, flag):
    parameter = flag.name.removeprefix("--").replace("-", "_")
    values = {each.name: None for each in SettingsFlags.options()}
    values[parameter] = flag.choices[-1] if flag.choices else VALUES[flag.kind]
    own = Settings(denoise=flag.name == "--keep-noisy")
    changed = SettingsFlags.of(values).over(own)
    found = {each.name for each in fields(Settings) if getattr(changed, each.name) != getattr(own, each.name)}
    assert found == ({"error", "passes"} if name == "error" else {name})


def test_a_request_can_be_changed_where_its_certificate_is_not(tmp_path):
    """A worker opens the scene of a request, on another machine than the command."""
    certificate = tmp_path / "a.pem"
    certificate.write_text("")
    usual = {each.name: each.default for each in RenderRequest.options()}
    given = {"scene": Path("a.usda"), "output": [Path("a.exr")], "scheduler": "tls://a:1", "tls_cert": certificate}
    request = RenderRequest.of({**usual, **given})
    certificate.unlink()
    assert replace(request, scene=Path("b.usda")).farm.files == {"cert": str(certificate)}
    with pytest.raises(typer.BadParameter, match="no such file"):
        RenderRequest.of({**usual, **given})
