"""Behaviours as generators: they read from top to bottom, and `yield` waits for the clock's next moment."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Steps = Generator[None, None, T]
