"""Designs of experiments: factors, their levels, the methods that combine them, and how good the result is."""

from __future__ import annotations

from ._covering import CoveringArray as CoveringArray
from ._design import Design as Design
from ._design import DesignPoint as DesignPoint
from ._design import Method as Method
from ._factorial import FullFactorial as FullFactorial
from ._factorial import OneByOne as OneByOne
from ._factors import INACTIVE as INACTIVE
from ._factors import Factor as Factor
from ._factors import Level as Level
from ._factors import Range as Range
from ._nested import Nested as Nested
from ._orthogonal import NearlyOrthogonalLatinHypercube as NearlyOrthogonalLatinHypercube
from ._orthogonal import OrthogonalLatinHypercube as OrthogonalLatinHypercube
from ._quality import DesignQuality as DesignQuality
from ._quality import design_quality as design_quality
from ._sampled import Halton as Halton
from ._sampled import LatinHypercube as LatinHypercube
from ._sampled import Sobol as Sobol
from ._screening import DefinitiveScreening as DefinitiveScreening
from ._screening import FractionalFactorial as FractionalFactorial
from ._screening import PlackettBurman as PlackettBurman
from ._stratified import Difficulties as Difficulties
from ._stratified import Stratified as Stratified
