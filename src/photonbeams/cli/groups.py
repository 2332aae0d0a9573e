"""Options of commands in groups: each group is a record, and its fields are options of the commands that take it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, TypeVar, dataclass_transform, get_type_hints

import typer

from ..setting import Setting

_F = TypeVar("_F", bound="Flags")

_MAY_BE_EMPTY = "camera"  # a template of Open Job Description cannot leave out a flag


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Flags:
    """A group of flags, made from the values of a command line. Subclasses become dataclasses, and may hold groups."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def options(cls) -> Iterator[Parameter]:
        """Yield the parameters that a command has for this group."""
        hints = get_type_hints(cls, include_extras=True)
        for each in fields(cls):  # type: ignore[arg-type]
            if _is_group(hints[each.name]):
                yield from hints[each.name].options()
            else:
                yield _parameter(each, hints[each.name])

    @classmethod
    def of(cls: type[_F], values: dict[str, Any]) -> _F:
        """Return the group with the `values` of a command line, by the names of its parameters."""
        hints = get_type_hints(cls)
        names = [each.name for each in fields(cls)]  # type: ignore[arg-type]
        return cls(**{name: hints[name].of(values) if _is_group(hints[name]) else values[name] for name in names})

    def given(self) -> Iterator[str]:
        """Yield the flags that are given: those whose values are not their defaults."""
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            if isinstance(value, Flags):
                yield from value.given()
            elif each.default is not MISSING and value != each.default and value != []:
                yield _declared(each.name, each.metadata.get("option"))


def _is_group(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Flags)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _declared(name: str, option: Any = None) -> str:
    """Return the first flag of an option, which it declares or has by its name."""
    return str(((option and option.param_decls) or (_flag(name),))[0])


def _parameter(own: Field[Any], kind: Any) -> Parameter:
    """Return the parameter for an option, which is described by the metadata of its field, or by its type."""
    option = own.metadata.get("option")
    if option is not None:
        if kind is bool and not option.param_decls:  # otherwise, it would have a second flag, --no-...
            option.param_decls = (_flag(own.name),)
        kind = Annotated[kind, option]
    default = Parameter.empty if own.default is MISSING else own.default
    return Parameter(own.name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def option(default: Any, help: str, *names: str, metavar: str | None = None, **values: Any) -> Any:
    """Return a field of a group: an option with the flags `names`, by default the field's name.

    `values` are attributes of the `Setting` whose values the option may have; without them, its type decides.
    """
    callback = checked(Setting(**values)) if values else None
    return field(
        default=default,
        metadata={"option": typer.Option(..., *names, help=help, metavar=metavar, callback=callback)},
    )


@contextmanager
def usage_errors(before: str = "") -> Iterator[None]:
    """Raise SceneError as BadParameter, with a text before its message, within the context."""
    from ..scene import SceneError

    try:
        yield
    except SceneError as error:
        raise typer.BadParameter(f"{before}{error}") from None


def checked(own: Setting) -> Callable[[typer.CallbackParam, Any], Any]:
    """Return a callback for an option, which refuses values that the setting may not have."""

    def check(parameter: typer.CallbackParam, value: Any) -> Any:
        with usage_errors():
            return value if value is None else own.checked(value, parameter.opts[0])

    return check


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with options in place of the groups that it takes, for Typer."""
    own = signature(command, eval_str=True).parameters
    groups = {name: each.annotation for name, each in own.items() if _is_group(each.annotation)}
    options: list[Parameter] = []
    for name, each in own.items():
        options += groups[name].options() if name in groups else [each.replace(kind=Parameter.KEYWORD_ONLY)]

    @wraps(command)
    def called(**values: Any) -> None:
        for each in options:
            value, may_be = values[each.name], each.name == _MAY_BE_EMPTY or each.default == ""
            given = value if isinstance(value, list) else [value]
            if "" in given and not may_be:  # as of a script's variable that is not set
                flag = _declared(each.name, *getattr(each.annotation, "__metadata__", ()))
                raise typer.BadParameter(f"{flag} is empty: expected a value, or no {flag}")
        plain = {name: values[name] for name in own if name not in groups}
        command(**plain, **{name: group.of(values) for name, group in groups.items()})

    called.__signature__ = Signature(options)  # type: ignore[attr-defined]
    called.__annotations__ = {each.name: each.annotation for each in options}
    return called
