"""The mission protocol: uploads, downloads and clearing of all three plans."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ._policy import Text, Verdict
from ._store import FENCE, MISSION, PLACELESS, RALLY, Item, Plans, identity_of

_ALL = 255


@dataclass(slots=True)
class _Transfer:
    """Something under way with one client; times are of the flight."""

    sender: Sender
    kind: int
    at: int = 0
    end: int = 0
    items: tuple[Item, ...] = ()  # what stands around a partial upload
    heard_ns: int = 0
    due_ns: int = 0

    def with_partner(self, sender: Sender) -> bool:
        return (self.sender.system, self.sender.component) == (sender.system, sender.component)


class MissionProtocol:
    """MISSION_COUNT, _ITEM, _ITEM_INT, _REQUEST*, _WRITE_PARTIAL_LIST, _CLEAR_ALL, _ACK. One upload at a time."""

    def __init__(self, board: ServiceContext, plans: Plans) -> None:
        self._board = board
        self._plans = plans
        self._policy = board.personality.missions
        self._upload: _Transfer | None = None
        self._taken: list[Item] = []
        self._download: _Transfer | None = None
        self._done: tuple[int, int, int] | None = None  # type, length and identity of what was taken last

    def handlers(self) -> Mapping[str, Handler]:
        return {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM_INT": lambda m, s: self._item(m, s, as_float=False),
            "MISSION_ITEM": lambda m, s: self._item(m, s, as_float=True),
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_REQUEST_INT": lambda m, s: self._give(m, s, as_float=False),
            "MISSION_REQUEST": lambda m, s: self._give(m, s, as_float=True),
            "MISSION_WRITE_PARTIAL_LIST": self._partial,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_ACK": self._client_ends,
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        """Ask again, or give up, where a client is silent."""
        now, policy = self._board.flight.time_ns, self._policy
        upload, download = self._upload, self._download
        if upload and now >= upload.due_ns:
            if now - upload.heard_ns >= round(policy.give_up_s * 1e9):
                self._upload, self._taken = None, []
                self._say(policy.gives_up_text)
                if policy.gives_up_with is not None:
                    self._acknowledge(upload.sender, upload.kind, policy.gives_up_with)
            else:
                self._ask()
        if download and now - download.heard_ns >= round(policy.give_up_s * 1e9):
            self._download = None
            self._say(policy.gives_up_text)

    def _count(self, m: Any, sender: Sender) -> None:
        policy, upload = self._policy, self._upload
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, policy.bad_type)
        elif policy.one_at_a_time and (upload or self._download):
            if upload and upload.with_partner(sender) and upload.kind == m.mission_type and upload.at == 0:
                self._ask()
            else:
                self._acknowledge(sender, m.mission_type, Verdict.ERROR)
        elif m.count > policy.limits[m.mission_type]:
            if policy.too_many_text:
                self._say((policy.too_many_text[0], policy.too_many_text[1].format(policy.limits[m.mission_type])))
            self._acknowledge(sender, m.mission_type, Verdict.NO_SPACE)
        else:
            if policy.clears_first:
                self._plans.by_type[m.mission_type].put(())
            self._begin(_Transfer(sender, m.mission_type, 0, m.count))

    def _partial(self, m: Any, sender: Sender) -> None:
        if not self._policy.partial or m.mission_type not in self._plans.by_type:
            return
        stored = self._plans.by_type[m.mission_type].items
        if not 0 <= m.start_index <= m.end_index < len(stored):
            self._acknowledge(sender, m.mission_type, Verdict.ERROR)
        else:
            self._begin(_Transfer(sender, m.mission_type, m.start_index, m.end_index + 1, stored))

    def _begin(self, transfer: _Transfer) -> None:
        transfer.heard_ns = self._board.flight.time_ns
        self._upload, self._taken = transfer, []
        if transfer.at == transfer.end:
            self._finish(transfer)
        else:
            self._ask()

    def _ask(self) -> None:
        upload = self._upload
        assert upload
        upload.due_ns = self._board.flight.time_ns + round(self._policy.repeat_s * 1e9)
        upload.sender.channel.tell(
            self._policy.request,
            seq=upload.at,
            target_system=upload.sender.system,
            target_component=upload.sender.component,
            mission_type=upload.kind,
        )

    def _item(self, m: Any, sender: Sender, as_float: bool) -> None:
        policy, upload = self._policy, self._upload
        if m.current == 2 and policy.guided_items:
            return  # the navigator's
        if upload is None:
            self._item_without_upload(m, sender)
            return
        if not upload.with_partner(sender):
            return
        if m.mission_type != upload.kind:
            self._acknowledge(sender, upload.kind, Verdict.ERROR)
            return
        if m.seq != upload.at:
            upload.heard_ns = self._board.flight.time_ns
            if policy.wrong_sequence_ends:
                self._refuse(upload, Verdict.INVALID_SEQUENCE)
            return
        if as_float and policy.item_float_text and upload.at == 0:
            self._say(policy.item_float_text)
        item = _item_of(m, as_float)
        fault = policy.fault(upload.kind, item, as_float) if not (policy.home_first and m.seq == 0) else None
        if fault is not None:
            if policy.bad_item_text and fault is not Verdict.ERROR:
                self._say(policy.bad_item_text)
            self._refuse(upload, fault)
            return
        self._taken.append(item)
        upload.at += 1
        upload.heard_ns = self._board.flight.time_ns
        if upload.at == upload.end:
            self._finish(upload)
        else:
            self._ask()

    def _item_without_upload(self, m: Any, sender: Sender) -> None:
        done = self._done
        if done and self._policy.one_at_a_time and done[:2] == (m.mission_type, m.seq + 1):
            self._acknowledge(sender, m.mission_type, Verdict.ACCEPTED, done[2])  # the last item again: our answer was lost
            return
        if self._policy.no_upload_text:
            self._say(self._policy.no_upload_text)
        self._acknowledge(sender, m.mission_type, Verdict.ERROR)

    def _finish(self, upload: _Transfer) -> None:
        policy, taken = self._policy, tuple(self._taken)
        start = upload.end - len(taken)
        items = (*upload.items[:start], *taken, *upload.items[upload.end :])
        fault = policy.plan_fault(upload.kind, items)
        if fault:
            for text in fault[1]:
                self._say(text)
            self._refuse(upload, fault[0])
            return
        self._upload, self._taken = None, []
        self._done = (upload.kind, len(items), identity_of(items))
        if not policy.one_at_a_time or self._done[2] != self._plans.by_type[upload.kind].identity:
            self._plans.by_type[upload.kind].put(items)
        self._acknowledge(upload.sender, upload.kind, Verdict.ACCEPTED, self._done[2])
        if upload.kind in policy.taken_texts:
            self._say(policy.taken_texts[upload.kind])

    def _refuse(self, upload: _Transfer, verdict: Verdict) -> None:
        self._upload, self._taken = None, []
        self._acknowledge(upload.sender, upload.kind, verdict)

    def _list(self, m: Any, sender: Sender) -> None:
        if m.mission_type not in self._plans.by_type:
            self._acknowledge(sender, m.mission_type, self._policy.bad_type)
            return
        if self._upload:
            self._acknowledge(sender, m.mission_type, Verdict.ERROR if self._policy.one_at_a_time else Verdict.DENIED)
            return
        plan = self._plans.by_type[m.mission_type]
        more = {"opaque_id": plan.identity} if self._policy.one_at_a_time else {}
        sender.channel.tell(
            "MISSION_COUNT",
            count=len(plan.items),
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
            **more,
        )
        if plan.items and self._policy.one_at_a_time:
            self._download = _Transfer(sender, m.mission_type, heard_ns=self._board.flight.time_ns)

    def _give(self, m: Any, sender: Sender, as_float: bool) -> None:
        if m.mission_type not in self._plans.by_type:
            return
        items = self._plans.by_type[m.mission_type].items
        if self._download:
            self._download.heard_ns = self._board.flight.time_ns
        if m.seq >= len(items):
            if self._policy.past_the_end is not None:
                self._acknowledge(sender, m.mission_type, self._policy.past_the_end)
            return
        if as_float and self._policy.request_float_text and m.seq == 0:
            self._say(self._policy.request_float_text)
        self._tell_item(m, sender, self._shown(m, items), as_float)

    def _shown(self, m: Any, items: tuple[Item, ...]) -> Item:
        item: Item = items[m.seq]
        home = self._board.flight.home
        if m.seq == 0 and m.mission_type == MISSION and self._policy.home_first and home:
            return Item(16, 0, (0.0, 0.0, 0.0, 0.0), home.latitude_e7, home.longitude_e7, home.altitude_m)
        return item

    def _tell_item(self, m: Any, sender: Sender, item: Item, as_float: bool) -> None:
        degrees = as_float and item.frame not in PLACELESS
        policy = self._policy
        sender.channel.tell(
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

    def _clear(self, m: Any, sender: Sender) -> None:
        policy = self._policy
        if policy.one_at_a_time and (self._upload or self._download):
            self._say((2, "WPM: IGN CLEAR CMD: Busy"))
            return
        if m.mission_type == _ALL and policy.clears_all_types:
            kinds = [MISSION, FENCE, RALLY]
        elif m.mission_type in self._plans.by_type:
            kinds = [m.mission_type]
        else:
            self._acknowledge(sender, m.mission_type, policy.bad_type)
            return
        self._upload, self._taken = None, []
        for kind in kinds:
            self._plans.by_type[kind].put(())
        self._acknowledge(sender, m.mission_type, Verdict.ACCEPTED)

    def _client_ends(self, m: Any, sender: Sender) -> None:
        if self._download and self._download.with_partner(sender):
            self._download = None
        if self._upload and self._policy.client_cancels and self._upload.with_partner(sender) and m.type != Verdict.ACCEPTED:
            self._upload, self._taken = None, []

    def _acknowledge(self, sender: Sender, kind: int, verdict: int, identity: int = 0) -> None:
        more = {"opaque_id": identity} if self._policy.one_at_a_time and identity else {}
        sender.channel.tell(
            "MISSION_ACK",
            type=verdict,
            target_system=sender.system,
            target_component=sender.component,
            mission_type=kind,
            **more,
        )

    def _say(self, text: Text) -> None:
        self._board.texts.say(*text)


def _item_of(m: Any, as_float: bool) -> Item:
    """A wire item; degrees become 1e-7 degrees, and what fits no integer becomes a place that is none."""
    params = (m.param1, m.param2, m.param3, m.param4)
    item = Item(m.command, m.frame, params, 0, 0, m.z, m.autocontinue, m.current)
    if not as_float:
        return replace(item, x=m.x, y=m.y)
    scale = 1.0 if m.frame in PLACELESS else 1e7
    return replace(item, x=_whole(m.x * scale), y=_whole(m.y * scale))


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) and abs(value) < 2**31 - 1 else 2**31 - 1
