"""Commands whose options stand in frozen dataclasses: each field is an option, and the command gets one object."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command as typer reads it: in the place of a parameter that is a dataclass stand the fields of the dataclass,
    and those of dataclasses among them.
    """
    groups = {
        name: hint
        for name, hint in get_type_hints(command, include_extras=True).items()
        if is_dataclass(hint)
    }

    @wraps(command)
    def call(**values: Any) -> None:
        objects = {name: _object(group, values) for name, group in groups.items()}
        command(**{name: values[name] for name in signature(command).parameters if name in values}, **objects)

    parameters = list(_parameters(command))
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def _parameters(owner: Callable[..., Any]) -> Iterator[Parameter]:
    hints: dict[str, Any] = get_type_hints(owner, include_extras=True)
    for name, parameter in signature(owner).parameters.items():
        if is_dataclass(hints[name]):
            yield from _parameters(hints[name])
        else:
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=parameter.default, annotation=hints[name])


def _object(group: Any, values: dict[str, Any]) -> Any:
    hints = get_type_hints(group)
    return group(
        **{
            field.name: _object(hint, values)
            if is_dataclass(hint := hints[field.name])
            else values[field.name]
            for field in fields(group)
        }
    )
