"""What parameters of the fixed wing do."""

from __future__ import annotations

from parameter_effect import Effect, go, in_mode, sink_mps, speed_mps, up_mps, wait
from vehicle_client import NAN, Client, mavlink


def circling_mps(client: Client) -> float:
    get_up(client)
    client.fly(12.0)
    return speed_mps(client)


def get_up(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 538.0)
    wait(client, in_mode("AUTO_LOITER"), 60.0)


def wing_climbing(client: Client) -> float:
    get_up(client)
    go(client, 0, 300, 120)
    client.fly(10.0)
    return up_mps(client)


def wing_sinking(client: Client) -> float:
    get_up(client)
    go(client, 0, 300, 20)
    client.fly(8.0)
    return sink_mps(client)


WING = (
    Effect("FW_AIRSPD_TRIM", (14.0, 17.0), circling_mps, (14.0, 17.0), 0.6),
    Effect("FW_T_CLMB_R_SP", (1.5, 3.0), wing_climbing, (1.5, 3.0), 0.4),
    Effect("FW_T_SINK_R_SP", (1.0, 2.0), wing_sinking, (1.0, 2.0), 0.4),
)
