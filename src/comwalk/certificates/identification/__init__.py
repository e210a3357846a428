"""Identify the closed loop of a standing robot by a short experiment."""

from typing import TYPE_CHECKING

from ...lazy import exports_of

if TYPE_CHECKING:
    from .excitation import Experiment as Experiment
    from .excitation import standing_pattern as standing_pattern
    from .frequency_response import Estimate as Estimate
    from .frequency_response import ResponseFit as ResponseFit
    from .frequency_response import Responses as Responses
    from .identification import Identified as Identified
    from .identification import identify as identify
    from .loop_fit import equivalent_loop as equivalent_loop
    from .loop_fit import measured_margin as measured_margin

__getattr__, __dir__ = exports_of(__name__, __file__)
