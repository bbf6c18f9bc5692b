"""A saved model on a record that it has not seen."""

from .predict import predict as predict
from .result import Comparison as Comparison
from .result import Prediction as Prediction
