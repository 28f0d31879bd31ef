"""One decorated function declares a measure: its name, options, and what `rebar measures` says."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from made_run import simspec, tape

import test_ports
from bench.cli._app import run
from bench.contracts import Evidence, Option, Tape, plugins
from bench.simspec import SimSpec
from test_ports import DeclaredMeasure, Finding, Limit, measure, not_considered

PAGE = Path(__file__).parents[2] / "docs" / "measures.md"


@measure
def example(
    tape: Tape,
    simspec: SimSpec,
    *,
    kind: Literal["first", "second"],
    share: Annotated[float, Limit(lambda value: value < 1.0, "a number less than 1")] = 0.5,
    class_: str = "",
    count: int = 3,
    strict: bool = False,
) -> Finding:
    """The share as given."""
    return (
        not_considered("no class")
        if class_ == "none"
        else Finding(share, (Evidence(time_s=1.0, text=f"{kind} {count}"),))
    )


def observed(**options: Option) -> tuple[float | None, str]:
    spec = simspec()
    observation = example(
        "OBS-1", tape(spec), spec, {name.rstrip("_"): value for name, value in options.items()}
    )
    assert observation.considered == (observation.x is not None)
    return observation.x, observation.evidence[0].text


def test_name_options_and_description_come_from_the_function() -> None:
    """The keyword-only parameters are the options, in their order; a trailing underscore is dropped."""
    assert (example.name, example.description) == ("example", "The share as given.")
    assert [(option.name, option.default) for option in example.options] == [
        ("kind", None),
        ("share", 0.5),
        ("class", ""),
        ("count", 3),
        ("strict", False),
    ]


def test_options_reach_the_function_and_defaults_stand_for_the_others() -> None:
    """A whole number becomes a float where a float is declared."""
    assert observed(kind="first") == (0.5, "first 3")
    assert observed(kind="second", share=0, count=5) == (0.0, "second 5")
    assert observed(kind="second", class_="none") == (None, "no class")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({}, "measure 'example': needs option 'kind'"),
        ({"kind": "third"}, "option 'kind' is 'third'; it must be one of first, second"),
        ({"kind": "first", "share": 1.0}, "option 'share' is 1.0; it must be a number less than 1"),
        (
            {"kind": "first", "share": -0.5},
            "option 'share' is -0.5; it must be a number, finite and not negative",
        ),
        ({"kind": "first", "share": True}, "option 'share' is True; it must be a number"),
        ({"kind": "first", "share": float("inf")}, "it must be a number, finite"),
        ({"kind": "first", "count": 2.0}, "option 'count' is 2.0; it must be a whole number"),
        ({"kind": "first", "count": True}, "option 'count' is True; it must be a whole number"),
        ({"kind": "first", "strict": 1}, "option 'strict' is 1; it must be true or false"),
        ({"kind": "first", "class": 1.0}, "option 'class' is 1.0; it must be text"),
        (
            {"kind": "first", "class_": "x"},
            "unknown option 'class_'; known: kind, share, class, count, strict",
        ),
    ],
)
def test_a_wrong_option_is_named(options: dict[str, Option], complaint: str) -> None:
    """The message names the measure, the option and what is valid."""
    with pytest.raises(ValueError, match=r"^measure 'example': ") as error:
        example.check_options(options)
    assert complaint in str(error.value)


def test_a_function_with_a_wrong_signature_is_refused_at_declaration() -> None:
    """Options before the '*', or of a kind that no decomposition can write."""

    def with_positional_option(tape: Tape, simspec: SimSpec, within_m: float) -> Finding:
        raise NotImplementedError

    def with_list(tape: Tape, simspec: SimSpec, *, names: list) -> Finding:  # type: ignore[type-arg]
        raise NotImplementedError

    with pytest.raises(TypeError, match="'with_positional_option' must take the tape, the SimSpec"):
        measure(with_positional_option)
    with pytest.raises(TypeError, match="'with_list': parameter 'names' must be"):
        measure(with_list)


def declared_measures() -> dict[str, tuple[str, DeclaredMeasure]]:
    """Every measure of the package with its module, as the source has it."""
    modules = [
        importlib.import_module(info.name)
        for info in pkgutil.walk_packages(test_ports.__path__, "test_ports.")
    ]
    return {
        value.name: (module.__name__, value)
        for module in modules
        for value in vars(module).values()
        if isinstance(value, DeclaredMeasure) and value.find.__module__ == module.__name__
    }


def test_entry_points_and_code_have_the_same_names() -> None:
    ours = {
        name: entry.module
        for name, entry in plugins("rebar.measures").items()
        if entry.module.startswith("test_ports.")
    }
    assert ours == {name: module for name, (module, _) in declared_measures().items()}


def test_every_measure_and_module_says_what_it_measures() -> None:
    """A sentence of its own for each measure."""
    descriptions = [declared.description for _, declared in declared_measures().values()]
    assert all(text.endswith(".") for text in descriptions)
    assert len(set(descriptions)) == len(descriptions)
    assert all(importlib.import_module(module).__doc__ for module, _ in declared_measures().values())


def test_the_command_prints_each_measure_with_its_explanation(capsys: pytest.CaptureFixture[str]) -> None:
    """The list has every first sentence; a measure or a module alone has everything, options included."""

    def printed(*words: str) -> str:
        assert run(["measures", *words]) == 0
        return " ".join(capsys.readouterr().out.split())

    listed = printed()
    explained: dict[str, str] = {}
    for name, (module, declared) in declared_measures().items():
        summary = " ".join(declared.description.split("\n\n")[0].split())
        assert f" {name}: {summary}" in listed, name
        explained.setdefault(module, printed(module))
        assert f" {name}: {' '.join(declared.explanation.split())}" in explained[module], name
        assert " ".join(declared.conventions.split()) in explained[module], name
        assert all(f"- {option.name}" in explained[module] for option in declared.options), name
    alone = printed("evidence_count")
    assert "- min_frames (3)" in alone
    assert "evidence_true:" not in alone
    assert '- during: "", gps_drift, gps_off ("")' in printed("uncertainty_honest")
    assert "- role: bystander, adversary, clutter, sought, any (must be set)" in printed("track_share")
    assert printed("orders") == printed("test_ports.operator.orders")
    assert run(["measures", "order"]) == 2
    assert "order is neither a measure nor a module" in capsys.readouterr().err.replace(": is", " is")


def test_the_measure_on_the_page_works() -> None:
    """The example that an outside package would start from measures what it says."""
    names: dict[str, Any] = {"__name__": "your_package"}
    exec(
        compile(
            PAGE.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0], "measures.md", "exec"
        ),
        names,
    )
    flight, spec = tape(simspec()), simspec(mission={"altitude_m": 62.0})
    declared = names["cruise_height_kept"]
    assert declared("OBS-1", flight, spec, {}).x == 1.0
    assert declared("OBS-1", flight, spec, {"tolerance_m": 1.0}).x == 0.0
