"""Bayesian posterior of a fit: maximum, Laplace approximation, draws by NUTS."""

from .inference_data import inference_data as inference_data
from .inference_data import write_netcdf as write_netcdf
from .posterior import find_posterior as find_posterior
from .priors import read_priors as read_priors
from .result import Posterior as Posterior
