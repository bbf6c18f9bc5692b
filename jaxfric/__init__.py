"""Differentiable sliders that stick-slip: simulate, fit, control.

jaxfric loads its names and folders (`jaxfric.gains`, `jaxfric.study`) on first use. Importing
jaxfric is therefore fast and changes no settings. Fitting needs 64-bit numbers:
`jax.config.update("jax_enable_x64", True)`.
"""

from typing import TYPE_CHECKING

from .lazy import loader

if TYPE_CHECKING:
    from . import axis as axis
    from . import compensation as compensation
    from . import effects as effects
    from . import fitting as fitting
    from . import gains as gains
    from . import laws as laws
    from . import loop as loop
    from . import members as members
    from . import motion as motion
    from . import plot as plot
    from . import posterior as posterior
    from . import prediction as prediction
    from . import protocol as protocol
    from . import records as records
    from . import report as report
    from . import rig as rig
    from . import runs as runs
    from . import saved as saved
    from . import simulation as simulation
    from . import stability as stability
    from . import study as study
    from . import units as units
    from .axis import close_axis_loop as close_axis_loop
    from .axis import close_steady_loop as close_steady_loop
    from .cache import cache_compiled as cache_compiled
    from .compensation import Feedforward as Feedforward
    from .compensation import feedforward as feedforward
    from .errors import InputError as InputError
    from .fitting import Estimate as Estimate
    from .fitting import Fit as Fit
    from .fitting import fit as fit
    from .fitting import fit_many as fit_many
    from .gains import check_gains as check_gains
    from .gains import find_gains as find_gains
    from .gains import gain_schedule as gain_schedule
    from .gains import minimum_gains as minimum_gains
    from .laws import law_from_parameters as law_from_parameters
    from .loop import Loop as Loop
    from .loop import close_loop as close_loop
    from .loop import compare_laws as compare_laws
    from .motion import PiecewiseVelocity as PiecewiseVelocity
    from .posterior import find_posterior as find_posterior
    from .prediction import Prediction as Prediction
    from .prediction import predict as predict
    from .records import AxisRecord as AxisRecord
    from .records import Record as Record
    from .records import VelocitySteps as VelocitySteps
    from .records import find_steps as find_steps
    from .records import from_arrays as from_arrays
    from .records import read as read
    from .records import read_axis as read_axis
    from .records import read_steady as read_steady
    from .records import read_table as read_table
    from .rig import FirstOrderDrive as FirstOrderDrive
    from .rig import IdealDrive as IdealDrive
    from .rig import IdealSensor as IdealSensor
    from .rig import Inertial as Inertial
    from .rig import QuasiStatic as QuasiStatic
    from .rig import Rig as Rig
    from .rig.friction import AgeingEvolution as AgeingEvolution
    from .rig.friction import Dahl as Dahl
    from .rig.friction import GaussianStribeck as GaussianStribeck
    from .rig.friction import GeneralStribeck as GeneralStribeck
    from .rig.friction import HessSoom as HessSoom
    from .rig.friction import LogarithmicEffect as LogarithmicEffect
    from .rig.friction import RateState as RateState
    from .rig.friction import RegularisedEffect as RegularisedEffect
    from .rig.friction import SlipEvolution as SlipEvolution
    from .saved import law_from_fit as law_from_fit
    from .saved import law_from_table as law_from_table
    from .simulation import RESULTS as RESULTS
    from .simulation import InitialState as InitialState
    from .simulation import Trajectory as Trajectory
    from .simulation import jump_start as jump_start
    from .simulation import rest_start as rest_start
    from .simulation import simulate as simulate
    from .simulation import simulate_delay as simulate_delay
    from .simulation import step_start as step_start
    from .simulation import velocity_start as velocity_start
    from .stability.linear import LinearSlider as LinearSlider
    from .stability.linear import linearise as linearise
    from .stability.margins import stability_margin as stability_margin
    from .stability.theorem import critical_stiffness as critical_stiffness
    from .stability.theorem import rice_ruina_criterion as rice_ruina_criterion

__version__ = "0.1.0"

_HOMES = {
    "close_axis_loop": "axis",
    "close_steady_loop": "axis",
    "InputError": "errors",
    "cache_compiled": "cache",
    "Feedforward": "compensation",
    "feedforward": "compensation",
    "Estimate": "fitting",
    "Fit": "fitting",
    "fit": "fitting",
    "fit_many": "fitting",
    "check_gains": "gains",
    "find_gains": "gains",
    "minimum_gains": "gains",
    "law_from_fit": "saved",
    "law_from_parameters": "laws",
    "law_from_table": "saved",
    "gain_schedule": "gains",
    "Loop": "loop",
    "close_loop": "loop",
    "compare_laws": "loop",
    "PiecewiseVelocity": "motion",
    "AxisRecord": "records",
    "Record": "records",
    "VelocitySteps": "records",
    "find_posterior": "posterior",
    "Prediction": "prediction",
    "predict": "prediction",
    "find_steps": "records",
    "from_arrays": "records",
    "read": "records",
    "read_axis": "records",
    "read_steady": "records",
    "read_table": "records",
    "FirstOrderDrive": "rig",
    "IdealDrive": "rig",
    "IdealSensor": "rig",
    "Inertial": "rig",
    "QuasiStatic": "rig",
    "Rig": "rig",
    "AgeingEvolution": "rig.friction",
    "Dahl": "rig.friction",
    "GaussianStribeck": "rig.friction",
    "GeneralStribeck": "rig.friction",
    "HessSoom": "rig.friction",
    "LogarithmicEffect": "rig.friction",
    "RateState": "rig.friction",
    "RegularisedEffect": "rig.friction",
    "SlipEvolution": "rig.friction",
    "RESULTS": "simulation",
    "InitialState": "simulation",
    "Trajectory": "simulation",
    "jump_start": "simulation",
    "rest_start": "simulation",
    "simulate": "simulation",
    "simulate_delay": "simulation",
    "step_start": "simulation",
    "velocity_start": "simulation",
    "LinearSlider": "stability.linear",
    "critical_stiffness": "stability.theorem",
    "linearise": "stability.linear",
    "stability_margin": "stability.margins",
    "rice_ruina_criterion": "stability.theorem",
}
_MODULES = (
    "axis",
    "compensation",
    "effects",
    "fitting",
    "gains",
    "laws",
    "loop",
    "members",
    "motion",
    "plot",
    "posterior",
    "prediction",
    "protocol",
    "records",
    "report",
    "rig",
    "runs",
    "saved",
    "simulation",
    "stability",
    "study",
    "units",
)
_OLD = {
    "Start": "InitialState",
    "margin": "stability_margin",
    "schedule": "gain_schedule",
    "theorem": "rice_ruina_criterion",
    "whole_loops": "cli.xla.whole_loops",
}
"""Names of earlier versions, and what they are called now."""
__all__ = sorted(_HOMES)
__getattr__, __dir__ = loader(__name__, _HOMES, _MODULES, _OLD)
