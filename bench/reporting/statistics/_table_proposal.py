"""The tables that outcomes contradict, refitted, as YAML for a person to review. Nothing applies it."""

from __future__ import annotations

from typing import Any

from bench.documents import dump_value, read_document
from bench.visible_text import visible
from decompositions import DecompositionDocument, KeyFactor, decomposition_of

from ._calibration import Calibration, ColumnDisorder, TableCalibration

REVIEW = "Refitted to failure rates and not reviewed; before:"


def table_proposal(calibration: Calibration) -> str:
    """The proposed tables with their evidence: shared ones under `tables`, others under `observables`.

    The edited decomposition is checked before anything is returned: SetupError if it could not be loaded.
    """
    contradicted = calibration.contradicted
    edited = {table.name: _edited(table) for table in contradicted if table.proposed is not None}
    decomposition_of(_applied(calibration, edited))
    header = [*_header(calibration), *(line for table in contradicted for line in _evidence(table))]
    shared = {
        table.name: edited[table.name].model_dump(mode="json", exclude_defaults=True)
        for table in contradicted
        if table.is_shared and table.name in edited
    }
    single = [
        {
            "id": table.observables[0],
            "key_factors": [edited[table.name].model_dump(mode="json", exclude_defaults=True)],
        }
        for table in contradicted
        if not table.is_shared and table.name in edited
    ]
    body: dict[str, Any] = {"from": _source(calibration)}
    body |= {"tables": shared} if shared else {}
    body |= {"observables": single} if single else {}
    return "".join(f"# {visible(line)}".rstrip() + "\n" for line in header) + dump_value(body)


def _edited(table: TableCalibration) -> KeyFactor:
    assert table.proposed is not None
    # Two thousand characters are the limit of a reason.
    reason = f"{REVIEW} {table.row.reason}"[:2000]
    return table.row.model_copy(
        update={"ratings": table.proposed.ratings, "values": table.proposed.values, "reason": reason}
    )


def _applied(calibration: Calibration, edited: dict[str, KeyFactor]) -> DecompositionDocument:
    """The decomposition with the edits, as a person would make them."""
    document = calibration.decomposition.document
    observables = tuple(
        leaf.model_copy(
            update={
                "key_factors": tuple(
                    row if isinstance(row, str) else edited.get(f"{leaf.id}/{row.factor}", row)
                    for row in leaf.key_factors
                )
            }
        )
        for leaf in document.observables
    )
    tables = {name: edited.get(name, row) for name, row in document.tables.items()}
    changed = document.model_copy(update={"observables": observables, "tables": tables})
    return read_document(changed.model_dump_json(), DecompositionDocument, source="proposal")


def _header(calibration: Calibration) -> list[str]:
    return [
        "Key factor tables whose order the outcomes below contradict, with ratings refitted to the failure",
        "rates. Nothing applies this file: find the reason first (a factor that varies together with another,",
        "a measure that tests something else, too few agents), then copy what you accept into a decomposition.",
        "Under observables stands only the row that changes: keep the other rows of the observable.",
        f"{len(calibration.tables)} tables were looked at; by chance some are contradicted whose order is right.",
        "",
    ]


def _source(calibration: Calibration) -> dict[str, Any]:
    return {
        "decomposition": calibration.decomposition.name,
        "decomposition_sha256": calibration.decomposition.digest,
        "campaigns": [str(folder) for folder in calibration.folders],
        "agents": list(calibration.agents),
        "runs": calibration.runs,
        "design_points": calibration.design_points,
    }


def _evidence(table: TableCalibration) -> list[str]:
    association, row = table.association, table.row
    lines = [
        f"{table.name} ({row.factor}): {table.result}. {association.trials} trials, {association.failed} failed,",
        f"  {association.design_points} design points, {association.ratings} ratings, {tau_text(table)}",
        f"  used by {_listed(table.observables)}",
    ]
    lines += [
        f"  rating {row.ratings[column.column]:g} at {row.values[column.column]:g} {row.unit}: "
        f"{column.failed} of {column.trials} failed, adjusted {column.rate:.0%}"
        for column in table.columns
    ]
    lines += [f"  {disorder_text(row, disorder)}" for disorder in table.disorders]
    if table.no_proposal:
        lines.append(f"  no table is proposed: {table.no_proposal}")
    return [*lines, ""]


def tau_text(table: TableCalibration) -> str:
    """Tau-b with its interval and p, for people."""
    association = table.association
    if association.tau is None:
        return association.note
    ends = (
        association.note
        if association.low is None or association.high is None
        else f"95 % {association.low:.2f} to {association.high:.2f}"
    )
    return f"tau-b {association.tau:.2f} ({ends}), p {association.p:.3f}"


def disorder_text(row: KeyFactor, disorder: ColumnDisorder) -> str:
    """Two columns in the wrong order, for people."""
    easier, harder = row.values[disorder.easier], row.values[disorder.harder]
    return f"{easier:g} {row.unit} fails more often than {harder:g} {row.unit}, which is rated harder"


def _listed(observables: tuple[str, ...]) -> str:
    # More would only fill lines: the decomposition has them all.
    shown = ", ".join(observables[:8])
    return shown if len(observables) <= 8 else f"{shown} and {len(observables) - 8} more"
