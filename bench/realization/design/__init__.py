"""Designs of experiments: factors, their levels, methods that combine them, and how good a design is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._covering_arrays import CoveringArray as CoveringArray
    from ._design import Design as Design
    from ._design import DesignPoint as DesignPoint
    from ._design import Method as Method
    from ._factorial import FullFactorial as FullFactorial
    from ._factorial import OneByOne as OneByOne
    from ._factors import BASE as BASE
    from ._factors import INACTIVE as INACTIVE
    from ._factors import DesignFactor as DesignFactor
    from ._factors import FactorLevel as FactorLevel
    from ._factors import FactorRange as FactorRange
    from ._fractional_factorial import FractionalFactorial as FractionalFactorial
    from ._nested_hypercubes import Nested as Nested
    from ._orthogonal_hypercubes import NearlyOrthogonalLatinHypercube as NearlyOrthogonalLatinHypercube
    from ._orthogonal_hypercubes import OrthogonalLatinHypercube as OrthogonalLatinHypercube
    from ._quality import DesignQuality as DesignQuality
    from ._quality import design_quality as design_quality
    from ._screening import DefinitiveScreening as DefinitiveScreening
    from ._screening import PlackettBurman as PlackettBurman
    from ._space_filling import Halton as Halton
    from ._space_filling import LatinHypercube as LatinHypercube
    from ._space_filling import Sobol as Sobol
    from ._stratified import Difficulties as Difficulties
    from ._stratified import Stratified as Stratified

__getattr__ = lazy_names(__name__)
