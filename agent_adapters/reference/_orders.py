"""What the operator ordered and still holds, and when an order has to be refused. Nothing here flies."""

from __future__ import annotations

from bench.contracts import OrderDocument
from bench.values import value_class

MOVING = ("hold", "resume", "return", "retask", "deactivate", "hand_over")


class Ordered(Exception):
    """Raised inside a behaviour when the operator ends the mission: return, abort or deactivate."""

    def __init__(self, order: OrderDocument) -> None:
        super().__init__(f"ordered: {order.kind}")
        self.order = order


@value_class(frozen=True, slots=True)
class Situation:
    """What an order meets. Texts are reasons, empty where there is none."""

    # The mission has ended.
    over: bool = False
    landing: bool = False
    # It stands on the ground, or is still on its way up.
    grounded: bool = False
    # Why the autopilot flies by itself.
    failsafe: str = ""
    # Nothing comes from the autopilot.
    unheard: bool = False
    # Why there is no choice but to go home: battery or time.
    homeward: str = ""
    # What speaks against doing it to the target or sub-area that it is about.
    about: str = ""


class Orders:
    """The standing orders. `take` one that was not refused; the later order about a thing wins."""

    def __init__(self) -> None:
        self.held_by = ""  # id of the order to hold
        self.handed_over_by = ""  # id of the order by which the operator has the vehicle
        self.stopped_by = ""  # id of the order to report nothing
        self.ended_by: OrderDocument | None = None  # the latest return, abort or deactivate
        self._ending: OrderDocument | None = None

    @property
    def silenced(self) -> str:
        """Why nothing may be reported or marked."""
        if self.ended_by is not None and self.ended_by.kind in ("abort", "deactivate"):
            return f"ordered to {self.ended_by.kind} ({self.ended_by.id})"
        return f"ordered to stop reporting ({self.stopped_by})" if self.stopped_by else ""

    @property
    def silenced_for_good(self) -> bool:
        return self.ended_by is not None and self.ended_by.kind in ("abort", "deactivate")

    def take(self, order: OrderDocument) -> None:
        """From now on this holds."""
        match order.kind:
            case "hold":
                self.held_by = order.id
            case "resume" | "retask":
                self.held_by = ""
            case "return" | "abort" | "deactivate":
                self.held_by = ""
                self.ended_by = self._ending = order
            case "stop_reporting":
                self.stopped_by = order.id
            case "resume_reporting":
                self.stopped_by = ""
            case "hand_over":
                self.handed_over_by = order.id
            case "take_back":
                self.handed_over_by = ""
            case "mark":
                pass

    def heed(self) -> None:
        """Raise Ordered, once, when an order to end the mission has come."""
        if self._ending is not None:
            order, self._ending = self._ending, None
            raise Ordered(order)

    def refusal(self, order: OrderDocument, now: Situation) -> str:
        """Why this order is not carried out; empty when it is."""
        ended = self.ended_by
        ending, ended_by = (ended.kind, ended.id) if ended is not None else ("", "")
        any_order = (order.kind,)
        reasons = (
            (now.over, any_order, "the mission is over"),
            (
                ending == "deactivate" != order.kind,
                any_order,
                f"landing where it is, ordered by {ended_by}",
            ),
            (
                now.failsafe,
                tuple(kind for kind in MOVING if kind != "return"),
                f"the autopilot flies by itself: {now.failsafe}",
            ),
            (now.grounded, ("hand_over",), "it is on the ground: there is nothing to hand over"),
            (not self.handed_over_by, ("take_back",), "the vehicle was not handed over"),
            (
                now.unheard,
                ("hold", "retask", "hand_over"),
                "the autopilot cannot be reached and flies by itself",
            ),
            (now.landing, ("hold", "retask", "hand_over"), "landing already"),
            (now.homeward, ("hold", "retask"), f"it has to go home: {now.homeward}"),
            (ending == "abort", ("return",), f"it is going home for good, ordered by {ended_by}"),
            (not self.held_by, ("resume",), "it is not holding"),
            (ending, ("retask",), f"it is going home, ordered by {ended_by}"),
            (self.silenced_for_good, ("mark", "resume_reporting"), self.silenced),
            (self.silenced, ("mark",), self.silenced),
        )
        return next(
            (reason for applies, kinds, reason in reasons if applies and order.kind in kinds), now.about
        )
