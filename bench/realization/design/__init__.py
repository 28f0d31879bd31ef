"""Designs of experiments: factors, their levels, methods that combine them, and how good a design is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._design import Design as Design
    from ._design import DesignPoint as DesignPoint
    from ._design import Method as Method
    from ._factorial import FullFactorial as FullFactorial
    from ._factors import BASE as BASE
    from ._factors import INACTIVE as INACTIVE
    from ._factors import DesignFactor as DesignFactor
    from ._factors import FactorLevel as FactorLevel
    from ._factors import FactorRange as FactorRange
    from ._quality import DesignQuality as DesignQuality
    from ._quality import design_quality as design_quality
    from ._space_filling import Sobol as Sobol

__getattr__ = lazy_names(__name__)
