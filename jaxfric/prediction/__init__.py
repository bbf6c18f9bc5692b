"""Test a saved model on a record that the model was not fitted to."""

from .predict import predict as predict
from .result import Comparison as Comparison
from .result import Prediction as Prediction
