"""The mission protocol: uploads, downloads and clearing of all three plans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._missions import MissionPolicy, MissionResult
from ..state._flight_state import Behaviour
from ..state._plan_store import FENCE, MISSION, RALLY, MissionItem, StoredPlans, identity_of
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL

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
    received: list[MissionItem] = field(default_factory=list)
    received_ns: int = 0
    due_ns: int = 0
    had_float: bool = False  # one of the items came as a MISSION_ITEM

    def is_with(self, sender: MessageSender) -> bool:
        return (self.sender.system, self.sender.component) == (sender.system, sender.component)


class MissionProtocol:
    """MISSION_COUNT, _ITEM(_INT), _REQUEST*, _CLEAR_ALL, ...; one upload at a time, or one of each plan."""

    def __init__(self, context: ServiceContext, policy: MissionPolicy, plans: StoredPlans) -> None:
        self._context = context
        self._plans = plans
        self._policy = policy.transfer
        self._home_first = policy.home_first
        self._guided_items = policy.guided_items
        self._uploads: dict[int, _Transfer] = {}  # by the type of plan
        self._requested_float: set[int] = set()  # types of plans, since the last upload of each
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
        download = self._download
        for upload in list(self._uploads.values()):
            if now < upload.due_ns:
                continue
            if now - upload.received_ns >= round(policy.timeout_s * 1e9):
                del self._uploads[upload.kind]
                if policy.timeout_result is not None:
                    self._acknowledge(upload.sender, upload.kind, policy.timeout_result)
                self._context.texts.report(policy.timeout_texts[upload.kind])
            else:
                self._request_item(upload)
        if download and now - download.received_ns >= round(policy.timeout_s * 1e9):
            self._download = None
            self._context.texts.report(policy.timeout_texts[download.kind])

    def _upload_of(self, kind: int) -> _Transfer | None:
        """The upload that a message about plans of a type belongs to."""
        if self._policy.one_at_a_time:
            return next(iter(self._uploads.values()), None)
        return self._uploads.get(kind)

    def _take_count(self, m: Any, sender: MessageSender) -> None:
        policy, upload = self._policy, self._upload_of(m.mission_type)
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, policy.bad_type)
        elif policy.one_at_a_time and (upload or self._download):
            if upload and upload.is_with(sender) and upload.kind == m.mission_type and upload.index == 0:
                self._request_item(upload)
            else:
                self._acknowledge(sender, m.mission_type, MissionResult.ERROR)
        elif upload and not upload.is_with(sender):
            self._acknowledge(sender, m.mission_type, MissionResult.DENIED)
        elif m.count > policy.max_items[m.mission_type]:
            self._context.texts.report(policy.too_many_text, policy.max_items[m.mission_type])
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
        # An item behind the last one is added.
        if not 0 <= m.start_index <= m.end_index <= len(stored):
            self._acknowledge(sender, m.mission_type, MissionResult.ERROR)
            self._context.texts.report(self._policy.partial_refused_text)
        else:
            self._begin(_Transfer(sender, m.mission_type, m.start_index, m.end_index + 1, stored))

    def _begin(self, transfer: _Transfer) -> None:
        transfer.received_ns = self._context.flight.time_ns
        self._uploads[transfer.kind] = transfer
        if transfer.index == transfer.end:
            self._finish(transfer)
        else:
            self._requested_float.discard(transfer.kind)
            self._request_item(transfer)

    def _request_item(self, upload: _Transfer) -> None:
        upload.due_ns = self._context.flight.time_ns + round(self._policy.repeat_s * 1e9)
        upload.sender.answer(self._policy.request, seq=upload.index, mission_type=upload.kind)

    def _take_item(self, m: Any, sender: MessageSender, as_float: bool) -> None:
        policy, upload = self._policy, self._upload_of(m.mission_type)
        if m.current == _GUIDED and self._guided_items:
            # The navigator takes this item; it is no part of a plan.
            return
        if upload is None:
            self._take_item_without_upload(m, sender)
            return
        if not self._is_expected(upload, m, sender):
            return
        if as_float and policy.item_float_text and not upload.had_float:
            upload.had_float = True
            self._context.texts.report(policy.item_float_text)
        item = self._item_of(m, as_float)
        # Home, which is the first item of a mission but of no fence, comes back as the vehicle knows it.
        is_home = self._home_first and m.seq == 0 and upload.kind == MISSION
        fault = None if is_home else self._fault(upload, item, as_float)
        if fault is not None:
            if fault is not MissionResult.ERROR:
                self._context.texts.report(policy.bad_item_text)
            self._refuse(upload, fault)
            return
        upload.received.append(policy.stored(item) if upload.kind == MISSION else item)
        upload.index += 1
        upload.received_ns = self._context.flight.time_ns
        if upload.index == upload.end:
            self._finish(upload)
        else:
            self._request_item(upload)

    def _is_expected(self, upload: _Transfer, m: Any, sender: MessageSender) -> bool:
        """Whether an item is the next of an upload, from its client; answers where it is not."""
        if not upload.is_with(sender):
            if not self._policy.one_at_a_time:
                other = m.seq != upload.index
                result = MissionResult.INVALID_SEQUENCE if other else MissionResult.DENIED
                self._acknowledge(sender, upload.kind, result)
        elif m.mission_type != upload.kind:
            self._acknowledge(sender, upload.kind, MissionResult.ERROR)
        elif m.seq != upload.index:
            upload.received_ns = self._context.flight.time_ns
            if self._policy.wrong_sequence_ends:
                self._refuse(upload, MissionResult.INVALID_SEQUENCE)
        else:
            return True
        return False

    def _fault(self, upload: _Transfer, item: MissionItem, as_float: bool) -> MissionResult | None:
        fault = self._policy.refuse_item(upload.kind, item, as_float)
        if fault is None and item.command == MAV_CMD.DO_JUMP and self._policy.checks_jumps:
            there = 1.0 <= item.params[0] < max(upload.end, len(upload.items))
            return None if there else MissionResult.ERROR
        return fault

    def _take_item_without_upload(self, m: Any, sender: MessageSender) -> None:
        last = self._last
        if last and self._policy.one_at_a_time and last[:2] == (m.mission_type, m.seq + 1):
            # The last item comes again because the acknowledgement was lost.
            self._acknowledge(sender, m.mission_type, MissionResult.ACCEPTED, last[2])
            return
        self._context.texts.report(self._policy.no_upload_text)
        self._acknowledge(sender, m.mission_type, MissionResult.ERROR)

    def _finish(self, upload: _Transfer) -> None:
        policy, received = self._policy, tuple(upload.received)
        start = upload.end - len(received)
        items = (*upload.items[:start], *received, *upload.items[upload.end :])
        fault = policy.refuse_plan(upload.kind, items)
        if fault:
            self._context.texts.send_all(fault[1])
            self._refuse(upload, fault[0])
            return
        del self._uploads[upload.kind]
        self._last = (upload.kind, len(items), identity_of(items))
        if not policy.one_at_a_time or self._last[2] != self._plans.by_type[upload.kind].identity:
            self._plans.by_type[upload.kind].put(items)
        self._acknowledge(upload.sender, upload.kind, MissionResult.ACCEPTED, self._last[2])
        self._context.texts.report(policy.uploaded_texts.get(upload.kind))

    def _refuse(self, upload: _Transfer, verdict: MissionResult) -> None:
        del self._uploads[upload.kind]
        self._acknowledge(upload.sender, upload.kind, verdict)

    def _answer_list(self, m: Any, sender: MessageSender) -> None:
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, self._policy.bad_type)
            return
        if self._upload_of(m.mission_type):
            busy = MissionResult.ERROR if self._policy.one_at_a_time else MissionResult.DENIED
            self._acknowledge(sender, m.mission_type, busy)
            return
        self._send_count(m.mission_type, sender)
        if self._plans.by_type[m.mission_type].items and self._policy.one_at_a_time:
            self._download = _Transfer(sender, m.mission_type, received_ns=self._context.flight.time_ns)

    def _send_count(self, kind: int, sender: MessageSender) -> None:
        plan = self._plans.by_type[kind]
        ids = {"opaque_id": plan.identity} if self._policy.one_at_a_time else {}
        sender.answer("MISSION_COUNT", count=len(plan.items), mission_type=kind, **ids)

    def _answer_request(self, m: Any, sender: MessageSender, as_float: bool) -> None:
        if m.mission_type not in self._plans.by_type:
            return
        policy, kind = self._policy, m.mission_type
        items = self._plans.by_type[kind].items
        if self._download:
            self._download.received_ns = self._context.flight.time_ns
        if not policy.one_at_a_time and kind in self._uploads:
            self._acknowledge(sender, kind, MissionResult.DENIED)
            return
        item = self._shown(m, items)
        if item is None:
            verdict = policy.past_the_end(kind, m.seq, len(items))
            if verdict is not None:
                if kind == MISSION:
                    self._send_count(kind, sender)
                self._acknowledge(sender, kind, verdict)
            return
        if as_float and policy.request_float_text and kind not in self._requested_float:
            self._requested_float.add(kind)
            self._context.texts.report(policy.request_float_text)
        self._send_item(m, sender, item, as_float)

    def _shown(self, m: Any, items: tuple[MissionItem, ...]) -> MissionItem | None:
        """The item that a request asks for; None where there is none. Home is there without a mission too."""
        home = self._context.flight.home
        if m.seq == 0 and m.mission_type == MISSION and self._home_first and home:
            place = (home.latitude_e7, home.longitude_e7, home.altitude_m)
            return MissionItem(MAV_CMD.NAV_WAYPOINT, MAV_FRAME.GLOBAL, (0.0, 0.0, 0.0, 0.0), *place)
        return items[m.seq] if m.seq < len(items) else None

    def _send_item(self, m: Any, sender: MessageSender, item: MissionItem, as_float: bool) -> None:
        policy = self._policy
        degrees = as_float and policy.has_degrees(item.command, item.frame)
        sender.answer(
            "MISSION_ITEM" if as_float else "MISSION_ITEM_INT",
            **{f"param{number}": param for number, param in enumerate(item.params, start=1)},
            x=item.x * 1e-7 if degrees else item.x,
            y=item.y * 1e-7 if degrees else item.y,
            z=item.z,
            seq=m.seq,
            command=item.command,
            frame=policy.shown_frame(item, as_float),
            current=1 if m.seq == 0 and policy.one_at_a_time and m.mission_type == MISSION else 0,
            autocontinue=0 if m.mission_type != MISSION and not policy.one_at_a_time else item.autocontinue,
            mission_type=m.mission_type,
        )

    def _clear(self, m: Any, sender: MessageSender) -> None:
        policy = self._policy
        if policy.one_at_a_time and (self._uploads or self._download):
            self._context.texts.send(CRITICAL, "WPM: IGN CLEAR CMD: Busy")
            return
        kinds = [m.mission_type]
        if m.mission_type == _ALL and policy.clears_all_types:
            kinds = [MISSION, FENCE, RALLY]
        for result in (refusals := self._refuse_clearing(m, sender, kinds)):
            self._acknowledge(sender, m.mission_type, result)
        if refusals:
            return
        for kind in kinds:
            self._uploads.pop(kind, None)
            self._plans.by_type[kind].put(())
        self._acknowledge(sender, m.mission_type, MissionResult.ACCEPTED)
        for kind in kinds:
            self._context.texts.report(policy.cleared_texts.get(kind))

    def _refuse_clearing(self, m: Any, sender: MessageSender, kinds: list[int]) -> tuple[MissionResult, ...]:
        """How it is answered that plans of these kinds are not cleared; empty where they are."""
        flight, upload = self._context.flight, self._upload_of(m.mission_type)
        if not set(kinds) <= set(self._plans.by_type):
            return (self._policy.bad_type,)
        if upload and not upload.is_with(sender):
            return (MissionResult.DENIED, MissionResult.ERROR)
        flown = MISSION in kinds and flight.armed and flight.mode.behaviour is Behaviour.MISSION
        return (MissionResult.ERROR,) if flown and not self._policy.clears_flown_mission else ()

    def _take_acknowledgement(self, m: Any, sender: MessageSender) -> None:
        if self._download and self._download.is_with(sender):
            self._download = None
        upload = self._upload_of(m.mission_type)
        cancels = self._policy.client_cancels and m.type != MissionResult.ACCEPTED
        if upload and cancels and upload.is_with(sender):
            del self._uploads[upload.kind]

    def _acknowledge(self, sender: MessageSender, kind: int, verdict: int, identity: int = 0) -> None:
        ids = {"opaque_id": identity} if self._policy.one_at_a_time and identity else {}
        sender.answer("MISSION_ACK", type=verdict, mission_type=kind, **ids)

    def _item_of(self, m: Any, as_float: bool) -> MissionItem:
        """An item of a message, in 1e-7 degrees; a number too large for an integer is no place on Earth."""
        params = (m.param1, m.param2, m.param3, m.param4)
        item = MissionItem(m.command, m.frame, params, 0, 0, m.z, m.autocontinue, m.current)
        if not as_float:
            return replace(item, x=m.x, y=m.y)
        scale = 1e7 if self._policy.has_degrees(m.command, m.frame) else 1.0
        return replace(item, x=_coordinate(m.x * scale), y=_coordinate(m.y * scale))


def _coordinate(value: float) -> int:
    return round(value) if math.isfinite(value) and abs(value) < 2**31 - 1 else 2**31 - 1
