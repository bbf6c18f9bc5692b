"""The loop: find the effects that a model lacks, add them, report the model before and after."""

from .compare import LawComparison as LawComparison
from .compare import LawScore as LawScore
from .compare import compare_laws as compare_laws
from .findings import LoopCode as LoopCode
from .loop import close_loop as close_loop
from .refusal import Fault as Fault
from .refusal import Move as Move
from .refusal import Refusal as Refusal
from .result import VERDICTS as VERDICTS
from .result import CandidateScore as CandidateScore
from .result import LocationProfile as LocationProfile
from .result import Loop as Loop
from .result import Score as Score
from .result import ScreenedEffect as ScreenedEffect
