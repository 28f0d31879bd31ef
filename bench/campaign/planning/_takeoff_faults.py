"""Everything that is known to be wrong with a campaign before its first session, all of it at once."""

from __future__ import annotations

from collections.abc import Iterable

from bench.agents import load_manifest, program_faults, rung_of
from bench.contracts import AgentManifest
from bench.documents import dump_json
from bench.errors import Fault, SetupError
from bench.simspec import Camera, SimSpec
from bench.simulation import camera_faults, session_faults

# Of a vehicle, what its opening does not check: factors often vary these, and one look is enough for all.
_VARIED_VEHICLE_FIELDS = frozenset({"home", "gps", "camera", "more_cameras", "battery", "name"})


def takeoff_faults(simspecs: Iterable[SimSpec]) -> list[Fault]:
    """Why sessions with these SimSpecs would end before they fly: agents without manifest, program, options
    or the pace; vehicles, scenes, assets, parameters, failures and detectors that do not exist.

    Looks once at everything that several SimSpecs have in common. Places are not looked at.
    """
    faults: dict[str, Fault] = {}
    keys: set[str] = set()
    cameras: set[tuple[Camera, ...]] = set()
    for simspec in simspecs:
        faults |= {str(fault): fault for fault in simspec.asset_faults()}
        if simspec.vehicle.cameras not in cameras:
            cameras.add(simspec.vehicle.cameras)
            faults |= {str(fault): fault for fault in camera_faults(simspec)}
        vehicle = simspec.vehicle.model_dump_json(exclude=set(_VARIED_VEHICLE_FIELDS))
        # The parameters of the error model have nothing to be opened.
        perception = simspec.perception.model_dump_json(exclude={"model"})
        parts = (vehicle, dump_json(simspec.agent), dump_json(simspec.pace), simspec.world.scene, perception)
        key = "|".join(map(str, parts))
        if key not in keys:
            keys.add(key)
            # By its text: two agents of one campaign often have the same fault.
            faults |= {str(fault): fault for fault in _faults(simspec)}
    return list(faults.values())


def _faults(simspec: SimSpec) -> list[Fault]:
    try:
        manifest, folder = load_manifest(simspec.agent.manifest)
    except SetupError as error:
        return [Fault(f"agents: {fault.where}", fault.what, fault.remedy) for fault in error.faults]
    return [
        *_rung_faults(manifest, simspec),
        *program_faults(manifest, folder, simspec.agent.options),
        *session_faults(simspec, manifest),
    ]


def _rung_faults(manifest: AgentManifest, simspec: SimSpec) -> list[Fault]:
    try:
        rung_of(manifest, simspec.agent)
    except SetupError as error:
        return list(error.faults)
    return []
