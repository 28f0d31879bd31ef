"""The mission protocol: uploads, downloads and clearing of all three plans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._missions import MissionPolicy, MissionResult
from ..state._plan_store import FENCE, MISSION, RALLY, MissionItem, StoredPlans, identity_of
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL, StatusText

# MAV_MISSION_TYPE_ALL
_ALL = 255
# `current` of a MISSION_ITEM that is an order to go there.
_GUIDED = 2


@dataclass(slots=True)
class _Transfer:
    """An upload or a download of one client; times are of the flight."""

    sender: MessageSender
    kind: int
    index: int = 0
    end: int = 0
    items: tuple[MissionItem, ...] = ()  # the stored plan around a partial upload
    received_ns: int = 0
    due_ns: int = 0

    def is_with(self, sender: MessageSender) -> bool:
        return (self.sender.system, self.sender.component) == (sender.system, sender.component)


class MissionProtocol:
    """MISSION_COUNT, _ITEM, _ITEM_INT, _REQUEST*, _WRITE_PARTIAL_LIST, _CLEAR_ALL, _ACK.

    One upload at a time.
    """

    def __init__(self, context: ServiceContext, policy: MissionPolicy, plans: StoredPlans) -> None:
        self._context = context
        self._plans = plans
        self._policy = policy.transfer
        self._home_first = policy.home_first
        self._guided_items = policy.guided_items
        self._upload: _Transfer | None = None
        self._received: list[MissionItem] = []
        self._download: _Transfer | None = None
        self._last: tuple[int, int, int] | None = None  # type, length and id of the last plan

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {
            "MISSION_COUNT": self._take_count,
            "MISSION_ITEM_INT": lambda m, s: self._take_item(m, s, as_float=False),
            "MISSION_ITEM": lambda m, s: self._take_item(m, s, as_float=True),
            "MISSION_REQUEST_LIST": self._answer_list,
            "MISSION_REQUEST_INT": lambda m, s: self._answer_request(m, s, as_float=False),
            "MISSION_REQUEST": lambda m, s: self._answer_request(m, s, as_float=True),
            "MISSION_WRITE_PARTIAL_LIST": self._take_partial_list,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_ACK": self._take_acknowledgement,
        }

    def tick(self) -> None:
        """Request again, or give up, while a client is silent."""
        now, policy = self._context.flight.time_ns, self._policy
        upload, download = self._upload, self._download
        if upload and now >= upload.due_ns:
            if now - upload.received_ns >= round(policy.timeout_s * 1e9):
                self._upload, self._received = None, []
                self._send(policy.timeout_text)
                if policy.timeout_result is not None:
                    self._acknowledge(upload.sender, upload.kind, policy.timeout_result)
            else:
                self._request_item()
        if download and now - download.received_ns >= round(policy.timeout_s * 1e9):
            self._download = None
            self._send(policy.timeout_text)

    def _take_count(self, m: Any, sender: MessageSender) -> None:
        policy, upload = self._policy, self._upload
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, policy.bad_type)
        elif policy.one_at_a_time and (upload or self._download):
            if upload and upload.is_with(sender) and upload.kind == m.mission_type and upload.index == 0:
                self._request_item()
            else:
                self._acknowledge(sender, m.mission_type, MissionResult.ERROR)
        elif m.count > policy.max_items[m.mission_type]:
            if policy.too_many_text:
                self._send(
                    (
                        policy.too_many_text[0],
                        policy.too_many_text[1].format(policy.max_items[m.mission_type]),
                    )
                )
            self._acknowledge(sender, m.mission_type, MissionResult.NO_SPACE)
        else:
            # ArduPilot loses the old plan though the upload may fail.
            if policy.clears_at_start:
                self._plans.by_type[m.mission_type].put(())
            self._begin(_Transfer(sender, m.mission_type, 0, m.count))

    def _take_partial_list(self, m: Any, sender: MessageSender) -> None:
        if not self._policy.partial_lists or m.mission_type not in self._plans.by_type:
            return
        stored = self._plans.by_type[m.mission_type].items
        if not 0 <= m.start_index <= m.end_index < len(stored):
            self._acknowledge(sender, m.mission_type, MissionResult.ERROR)
        else:
            self._begin(_Transfer(sender, m.mission_type, m.start_index, m.end_index + 1, stored))

    def _begin(self, transfer: _Transfer) -> None:
        transfer.received_ns = self._context.flight.time_ns
        self._upload, self._received = transfer, []
        if transfer.index == transfer.end:
            self._finish(transfer)
        else:
            self._request_item()

    def _request_item(self) -> None:
        upload = self._upload
        assert upload
        upload.due_ns = self._context.flight.time_ns + round(self._policy.repeat_s * 1e9)
        upload.sender.channel.send_message(
            self._policy.request,
            seq=upload.index,
            target_system=upload.sender.system,
            target_component=upload.sender.component,
            mission_type=upload.kind,
        )

    def _take_item(self, m: Any, sender: MessageSender, as_float: bool) -> None:
        policy, upload = self._policy, self._upload
        if m.current == _GUIDED and self._guided_items:
            # The navigator takes this item; it is no part of a plan.
            return
        if upload is None:
            self._take_item_without_upload(m, sender)
            return
        if not upload.is_with(sender):
            return
        if m.mission_type != upload.kind:
            self._acknowledge(sender, upload.kind, MissionResult.ERROR)
            return
        if m.seq != upload.index:
            upload.received_ns = self._context.flight.time_ns
            if policy.wrong_sequence_ends:
                self._refuse(upload, MissionResult.INVALID_SEQUENCE)
            return
        if as_float and policy.item_float_text and upload.index == 0:
            self._send(policy.item_float_text)
        item = self._item_of(m, as_float)
        # Home, which is the first item of a mission but of no fence, comes back as the vehicle knows it.
        is_home = self._home_first and m.seq == 0 and upload.kind == MISSION
        fault = None if is_home else policy.refuse_item(upload.kind, item, as_float)
        if fault is not None:
            if policy.bad_item_text and fault is not MissionResult.ERROR:
                self._send(policy.bad_item_text)
            self._refuse(upload, fault)
            return
        self._received.append(policy.stored(item) if upload.kind == MISSION else item)
        upload.index += 1
        upload.received_ns = self._context.flight.time_ns
        if upload.index == upload.end:
            self._finish(upload)
        else:
            self._request_item()

    def _take_item_without_upload(self, m: Any, sender: MessageSender) -> None:
        last = self._last
        if last and self._policy.one_at_a_time and last[:2] == (m.mission_type, m.seq + 1):
            # The last item comes again because the acknowledgement was lost.
            self._acknowledge(sender, m.mission_type, MissionResult.ACCEPTED, last[2])
            return
        if self._policy.no_upload_text:
            self._send(self._policy.no_upload_text)
        self._acknowledge(sender, m.mission_type, MissionResult.ERROR)

    def _finish(self, upload: _Transfer) -> None:
        policy, received = self._policy, tuple(self._received)
        start = upload.end - len(received)
        items = (*upload.items[:start], *received, *upload.items[upload.end :])
        fault = policy.refuse_plan(upload.kind, items)
        if fault:
            for text in fault[1]:
                self._send(text)
            self._refuse(upload, fault[0])
            return
        self._upload, self._received = None, []
        self._last = (upload.kind, len(items), identity_of(items))
        if not policy.one_at_a_time or self._last[2] != self._plans.by_type[upload.kind].identity:
            self._plans.by_type[upload.kind].put(items)
        self._acknowledge(upload.sender, upload.kind, MissionResult.ACCEPTED, self._last[2])
        if upload.kind in policy.uploaded_texts:
            self._send(policy.uploaded_texts[upload.kind])

    def _refuse(self, upload: _Transfer, verdict: MissionResult) -> None:
        self._upload, self._received = None, []
        self._acknowledge(upload.sender, upload.kind, verdict)

    def _answer_list(self, m: Any, sender: MessageSender) -> None:
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, self._policy.bad_type)
            return
        if self._upload:
            self._acknowledge(
                sender,
                m.mission_type,
                MissionResult.ERROR if self._policy.one_at_a_time else MissionResult.DENIED,
            )
            return
        plan = self._plans.by_type[m.mission_type]
        ids = {"opaque_id": plan.identity} if self._policy.one_at_a_time else {}
        sender.channel.send_message(
            "MISSION_COUNT",
            count=len(plan.items),
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
            **ids,
        )
        if plan.items and self._policy.one_at_a_time:
            self._download = _Transfer(sender, m.mission_type, received_ns=self._context.flight.time_ns)

    def _answer_request(self, m: Any, sender: MessageSender, as_float: bool) -> None:
        if m.mission_type not in self._plans.by_type:
            return
        items = self._plans.by_type[m.mission_type].items
        if self._download:
            self._download.received_ns = self._context.flight.time_ns
        if m.seq >= len(items):
            if self._policy.past_the_end is not None:
                self._acknowledge(sender, m.mission_type, self._policy.past_the_end)
            return
        if as_float and self._policy.request_float_text and m.seq == 0:
            self._send(self._policy.request_float_text)
        self._send_item(m, sender, self._shown(m, items), as_float)

    def _shown(self, m: Any, items: tuple[MissionItem, ...]) -> MissionItem:
        item: MissionItem = items[m.seq]
        home = self._context.flight.home
        if m.seq == 0 and m.mission_type == MISSION and self._home_first and home:
            return MissionItem(
                MAV_CMD.NAV_WAYPOINT,
                MAV_FRAME.GLOBAL,
                (0.0, 0.0, 0.0, 0.0),
                home.latitude_e7,
                home.longitude_e7,
                home.altitude_m,
            )
        return item

    def _send_item(self, m: Any, sender: MessageSender, item: MissionItem, as_float: bool) -> None:
        policy = self._policy
        degrees = as_float and policy.has_degrees(item.command, item.frame)
        sender.channel.send_message(
            "MISSION_ITEM" if as_float else "MISSION_ITEM_INT",
            param1=item.params[0],
            param2=item.params[1],
            param3=item.params[2],
            param4=item.params[3],
            x=item.x * 1e-7 if degrees else item.x,
            y=item.y * 1e-7 if degrees else item.y,
            z=item.z,
            seq=m.seq,
            command=item.command,
            frame=policy.shown_frame(item, as_float),
            current=1 if m.seq == 0 and policy.one_at_a_time and m.mission_type == MISSION else 0,
            autocontinue=0 if m.mission_type != MISSION and not policy.one_at_a_time else item.autocontinue,
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
        )

    def _clear(self, m: Any, sender: MessageSender) -> None:
        policy = self._policy
        if policy.one_at_a_time and (self._upload or self._download):
            self._send((CRITICAL, "WPM: IGN CLEAR CMD: Busy"))
            return
        if m.mission_type == _ALL and policy.clears_all_types:
            kinds = [MISSION, FENCE, RALLY]
        elif m.mission_type in self._plans.by_type:
            kinds = [m.mission_type]
        else:
            self._acknowledge(sender, m.mission_type, policy.bad_type)
            return
        self._upload, self._received = None, []
        for kind in kinds:
            self._plans.by_type[kind].put(())
        self._acknowledge(sender, m.mission_type, MissionResult.ACCEPTED)

    def _take_acknowledgement(self, m: Any, sender: MessageSender) -> None:
        if self._download and self._download.is_with(sender):
            self._download = None
        if (
            self._upload
            and self._policy.client_cancels
            and self._upload.is_with(sender)
            and m.type != MissionResult.ACCEPTED
        ):
            self._upload, self._received = None, []

    def _acknowledge(self, sender: MessageSender, kind: int, verdict: int, identity: int = 0) -> None:
        ids = {"opaque_id": identity} if self._policy.one_at_a_time and identity else {}
        sender.channel.send_message(
            "MISSION_ACK",
            type=verdict,
            target_system=sender.system,
            target_component=sender.component,
            mission_type=kind,
            **ids,
        )

    def _item_of(self, m: Any, as_float: bool) -> MissionItem:
        """An item of a message; degrees become 1e-7 degrees, and a number too large for an integer a place
        that is not on Earth.
        """
        params = (m.param1, m.param2, m.param3, m.param4)
        item = MissionItem(m.command, m.frame, params, 0, 0, m.z, m.autocontinue, m.current)
        if not as_float:
            return replace(item, x=m.x, y=m.y)
        scale = 1e7 if self._policy.has_degrees(m.command, m.frame) else 1.0
        return replace(item, x=_coordinate(m.x * scale), y=_coordinate(m.y * scale))

    def _send(self, text: StatusText) -> None:
        self._context.texts.send(*text)


def _coordinate(value: float) -> int:
    return round(value) if math.isfinite(value) and abs(value) < 2**31 - 1 else 2**31 - 1
