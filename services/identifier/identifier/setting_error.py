"""The refusal of a setting, with the field that is wrong."""


class SettingError(ValueError):
    """A setting that is not allowed.

    Parameters
    ----------
    message
        One sentence: the value, what is allowed, what to do.
    field
        Path of the field of `duralab.v1.IdentifyRequest` that is wrong.
    """

    def __init__(self, message: str, *, field: str) -> None:
        super().__init__(message)
        self.field = field
