"""One decorated function declares a measure: its name, its options, and what docs/measures.md says about
it.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from made_run import simspec, tape

from bench.contracts import Evidence, Option, Tape, plugins
from bench.simspec import SimSpec
from test_ports import Finding, Limit, measure, not_considered
from test_ports.documentation import PAGE, declared_in, main, measure_modules, with_tables

TEXT = PAGE.read_text(encoding="utf-8")


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
    run = simspec()
    observation = example(
        "OBS-1", tape(run), run, {name.rstrip("_"): value for name, value in options.items()}
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


def test_entry_points_code_and_page_have_the_same_names() -> None:
    """Each entry point names the module that declares the measure; the page has a section for each module."""
    declared = {
        declared_measure.name: f"{module.__name__}:{declared_measure.name}"
        for module in measure_modules()
        for declared_measure in declared_in(module)
    }
    ours = {
        name: entry.value
        for name, entry in plugins("rebar.measures").items()
        if entry.value.startswith("test_ports.")
    }
    assert ours == declared
    assert {row.split("`")[1] for row in TEXT.splitlines() if row.startswith("| `")} == set(declared)
    assert {line.split("`")[1] for line in TEXT.splitlines() if line.startswith("**`")} == set(declared)


def test_every_measure_and_module_says_what_it_measures() -> None:
    """A sentence of its own for each measure."""
    descriptions = [
        declared_measure.description
        for module in measure_modules()
        for declared_measure in declared_in(module)
    ]
    assert all(text.endswith(".") for text in descriptions)
    assert len(set(descriptions)) == len(descriptions)
    assert all(module.__doc__ for module in measure_modules())


def test_the_page_is_up_to_date(capsys: pytest.CaptureFixture[str]) -> None:
    """`python -m test_ports.documentation` would change nothing."""
    assert main(["--check"]) == 0, capsys.readouterr().err


def test_an_out_of_date_page_is_found_and_updated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A default that changed on the page only comes back; the words around the tables stay."""
    page = tmp_path / "measures.md"
    page.write_text(TEXT.replace("`radius_m` (15)", "`radius_m` (16)") + "Last words.\n", encoding="utf-8")
    monkeypatch.setattr(importlib.import_module("test_ports.documentation"), "PAGE", page)
    assert main(["--check"]) == 1
    assert "python -m test_ports.documentation" in capsys.readouterr().err
    assert main([]) == 0
    assert page.read_text(encoding="utf-8") == TEXT + "Last words.\n"


def test_a_module_without_a_section_is_named() -> None:
    """A new module with measures cannot be forgotten on the page."""
    with pytest.raises(ValueError, match=r"modules with measures: .*test_ports\.safety\.limits"):
        with_tables(TEXT.replace("measures of test_ports.safety.limits", "no measures"))


def test_the_measure_on_the_page_works() -> None:
    """The example that an outside package would start from measures what it says."""
    names: dict[str, Any] = {"__name__": "your_package"}
    exec(compile(TEXT.split("```python\n")[1].split("```")[0], "measures.md", "exec"), names)
    run, spec = tape(simspec()), simspec(mission={"altitude_m": 62.0})
    declared = names["cruise_height_kept"]
    assert declared("OBS-1", run, spec, {}).x == 1.0
    assert declared("OBS-1", run, spec, {"tolerance_m": 1.0}).x == 0.0
