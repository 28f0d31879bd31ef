"""SVG drawings with two axes: no script draws them, so they look alike on a screen, on paper and without JavaScript."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from markupsafe import Markup, escape

from bench.visible_text import visible

Range = tuple[float, float]
Points = Iterable[tuple[float, float]]

# Corners and direction of the first one, in degrees clockwise from the right.
_POLYGONS = {
    "square": (4, 45),
    "diamond": (4, 0),
    "triangle-up": (3, -90),
    "triangle-down": (3, 90),
    "triangle-right": (3, 0),
    "pentagon": (5, -90),
    "hexagon": (6, 0),
}
_PLUS = (
    (-1, -0.35), (-0.35, -0.35), (-0.35, -1), (0.35, -1), (0.35, -0.35), (1, -0.35),
    (1, 0.35), (0.35, 0.35), (0.35, 1), (-0.35, 1), (-0.35, 0.35), (-1, 0.35),
)  # fmt: skip


@dataclass(slots=True)
class Plot:
    """A drawing of `width` by `height` pixels. Places are in the units of its axes, sizes in pixels, colours are of CSS.

    `margins` are left, right, top and bottom. `y_range` runs from the bottom to the top.
    """

    label: str
    width: float
    height: float
    x_range: Range
    y_range: Range
    margins: tuple[float, float, float, float] = (44, 14, 8, 34)
    parts: list[str] = field(default_factory=list)
    legend: list[tuple[str, str]] = field(default_factory=list)

    def x_px(self, x: float) -> float:
        left, right, _, _ = self.margins
        low, high = self.x_range
        return left + (x - low) / (high - low) * (self.width - left - right)

    def y_px(self, y: float) -> float:
        _, _, top, bottom = self.margins
        low, high = self.y_range
        return self.height - bottom - (y - low) / (high - low) * (self.height - top - bottom)

    def line(
        self,
        points: Points,
        colour: str,
        title: str = "",
        *,
        width: float = 1.0,
        dash: str = "",
        fill: str = "none",
        opacity: float = 1.0,
    ) -> None:
        """A polyline; a filled one is closed."""
        places = " ".join(f"{_px(self.x_px(x))},{_px(self.y_px(y))}" for x, y in points)
        more = (f' stroke-dasharray="{dash}"' if dash else "") + (
            f' opacity="{opacity:g}"' if opacity < 1 else ""
        )
        style = f'fill="{fill}" stroke="{colour}" stroke-width="{width:g}"{more}'
        self._add("polyline" if fill == "none" else "polygon", f'points="{places}" {style}', title)

    def mark(
        self,
        symbol: str,
        place: tuple[float, float],
        size: float,
        colour: str,
        title: str = "",
        *,
        fill: str | None = None,
        width: float = 1.0,
    ) -> None:
        """A symbol of `size` pixels, of one colour where no `fill` is given."""
        kind, geometry = _symbol(symbol, self.x_px(place[0]), self.y_px(place[1]), size / 2.0)
        self._add(
            kind, f'{geometry} fill="{fill or colour}" stroke="{colour}" stroke-width="{width:g}"', title
        )

    def crowd(self, symbol: str, places: Points, size: float, colour: str) -> None:
        """Many marks as one element, without titles: a crowd of single ones would be most of a page."""
        radius = size / 2.0
        shapes = []
        for x, y in places:
            x_px, y_px = self.x_px(x), self.y_px(y)
            if symbol == "circle":
                half = f"a{_px(radius)} {_px(radius)} 0 1 0"
                shapes.append(f"M{_px(x_px - radius)} {_px(y_px)}{half} {_px(size)} 0{half} {_px(-size)} 0")
            else:
                side = 0.7 * radius
                shapes.append(
                    f"M{_px(x_px - side)} {_px(y_px - side)}h{_px(2 * side)}v{_px(2 * side)}h{_px(-2 * side)}z"
                )
        self._add(
            "path", f'd="{"".join(shapes)}" fill="{colour}" stroke="var(--paper)" stroke-width=".8"', ""
        )

    def tracks(self, tracks: Iterable[Points], colour: str) -> None:
        """Many thin lines as one element."""
        lines = (" ".join(f"{_px(self.x_px(x))} {_px(self.y_px(y))}" for x, y in track) for track in tracks)
        text = "".join(f"M{line}" for line in lines)
        self._add("path", f'd="{text}" fill="none" stroke="{colour}" opacity=".55"', "")

    def text(
        self,
        x: float,
        y: float,
        text: str,
        colour: str = "var(--ink)",
        *,
        anchor: str = "middle",
        dx_px: float = 0,
        dy_px: float = 4,
    ) -> None:
        place = f'x="{_px(self.x_px(x) + dx_px)}" y="{_px(self.y_px(y) + dy_px)}"'
        self.parts.append(
            f'<text {place} fill="{colour}" text-anchor="{anchor}">{escape(visible(text))}</text>'
        )

    def rect(self, x: Range, y: Range, fill: str, edge: str, title: str = "") -> None:
        left, right = self.x_px(x[0]), self.x_px(x[1])
        top, bottom = self.y_px(y[1]), self.y_px(y[0])
        size = f'width="{_px(right - left)}" height="{_px(bottom - top)}"'
        self._add("rect", f'x="{_px(left)}" y="{_px(top)}" {size} fill="{fill}" stroke="{edge}"', title)

    def x_axis(self, ticks: Iterable[tuple[float, str]], title: str = "", *, grid: bool = True) -> None:
        for value, text in ticks:
            if grid:
                self.line(((value, self.y_range[0]), (value, self.y_range[1])), "var(--grid)")
            self.text(value, self.y_range[0], text, dy_px=15)
        self.text(sum(self.x_range) / 2.0, self.y_range[0], title, "var(--ink-soft)", dy_px=30)

    def y_axis(self, ticks: Iterable[tuple[float, str]], title: str = "", *, right: bool = False) -> None:
        edge, anchor, aside = (self.x_range[1], "start", 5) if right else (self.x_range[0], "end", -5)
        for value, text in ticks:
            if not right:
                self.line(((self.x_range[0], value), (self.x_range[1], value)), "var(--grid)")
            self.text(edge, value, text, anchor=anchor, dx_px=aside)
        across = self.width - 8 if right else 10
        place = f'x="{across:g}" y="{_px(self.height / 2)}" transform="rotate(-90 {across:g} {_px(self.height / 2)})"'
        self.parts.append(f'<text {place} fill="var(--ink-soft)" text-anchor="middle">{escape(title)}</text>')

    def explain(self, symbol: str, colour: str, text: str, *, fill: str | None = None) -> None:
        """An entry of the key below the drawing. `line` and `line DASH` are symbols too."""
        style = f'fill="{fill or colour}" stroke="{colour}" stroke-width="1.5"'
        if symbol.startswith("line"):
            shape = f'<path d="M1 8H21" {style} stroke-dasharray="{symbol[5:] or "none"}"/>'
        else:
            kind, attributes = _symbol(symbol, 11, 8, 6)
            shape = f"<{kind} {attributes} {style}/>"
        if (shape, text) not in self.legend:
            self.legend.append((shape, text))

    def markup(self) -> Markup:
        """The drawing, with its key below."""
        key = "".join(
            f'<li><svg width="22" height="16" aria-hidden="true">{shape}</svg>{escape(visible(text))}</li>'
            for shape, text in self.legend
        )
        return Markup(
            f'<svg viewBox="0 0 {self.width:g} {_px(self.height)}" role="img" aria-label="{escape(visible(self.label))}">'
            + "".join(self.parts)
            + "</svg>"
            + (f'<ul class="key small">{key}</ul>' if key else "")
        )

    def file(self, style: str) -> str:
        """The drawing as a file of its own, on paper of its own, with its key in two columns below."""
        rows = -(-len(self.legend) // 2)
        height = self.height + 18 * rows + 8
        key = "".join(
            f'<g transform="translate({12 + self.width / 2 * (place // rows):g} {self.height + 18 * (place % rows):g})">'
            f'{shape}<text x="30" y="12" fill="var(--ink)">{escape(visible(text))}</text></g>'
            for place, (shape, text) in enumerate(self.legend)
        )
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {_px(height)}" role="img">'
            f"<title>{escape(visible(self.label))}</title><style>{style}</style>"
            f'<rect width="100%" height="100%" fill="var(--paper)"/>{"".join(self.parts)}{key}</svg>\n'
        )

    def _add(self, kind: str, attributes: str, title: str) -> None:
        end = f"><title>{escape(visible(title))}</title></{kind}>" if title else "/>"
        self.parts.append(f"<{kind} {attributes}{end}")


def round_ticks(low: float, high: float, count: int = 6) -> list[tuple[float, str]]:
    """Round values between two others, some `count` of them."""
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    first = math.ceil(low / step)
    return [(step * place, f"{step * place:g}") for place in range(first, math.floor(high / step) + 1)]


def _symbol(symbol: str, x: float, y: float, radius: float) -> tuple[str, str]:
    """An element and its geometry."""
    if symbol == "circle":
        return "circle", f'cx="{_px(x)}" cy="{_px(y)}" r="{_px(radius)}"'
    if symbol == "bar":
        return "path", f'd="M{_px(x)} {_px(y - radius)}V{_px(y + radius)}"'
    corners: Sequence[tuple[float, float]]
    if symbol in ("cross", "x"):
        turn = math.radians(45.0 if symbol == "x" else 0.0)
        corners = [
            (a * math.cos(turn) - b * math.sin(turn), a * math.sin(turn) + b * math.cos(turn))
            for a, b in _PLUS
        ]
    elif symbol == "star":
        corners = [_corner(36 * place - 90, 1.0 if place % 2 == 0 else 0.45) for place in range(10)]
    else:
        count, first = _POLYGONS[symbol]
        corners = [_corner(first + 360 / count * place) for place in range(count)]
    points = " ".join(f"{_px(x + radius * a)},{_px(y + radius * b)}" for a, b in corners)
    return "polygon", f'points="{points}"'


def _corner(degrees: float, radius: float = 1.0) -> tuple[float, float]:
    return radius * math.cos(math.radians(degrees)), radius * math.sin(math.radians(degrees))


def _px(value: float) -> str:
    # A tenth of a pixel is finer than any screen; adding 0 turns a negative zero into a positive one.
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")
