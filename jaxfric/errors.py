"""The one exception that a user's input can raise.

Failures of a computation are values (a `result` on every result object). Input
that cannot be understood raises `InputError`: one line that says what is wrong,
where, and what to do. The command prints that line and exits with code 2.
"""


class InputError(ValueError):
    """Input that cannot be used: what is wrong, where, what to do, on one line."""

    def __init__(self, message: str):
        super().__init__(" ".join(str(message).split()))
