"""Errors that people read: each message names the file or id, the finding, the rule and the remedy."""

_SUGGESTIONS = ("known: ", "did you mean ", "such as ", "the last ones: ")  # they are no rules


class UppliedError(Exception):
    """Base of every error this package raises on purpose.

    Parameters
    ----------
    what, finding : str
        The file, id or setting that is concerned, and what was found there.
    rule, remedy : str, optional
        What is allowed, or a suggestion; and what the reader can do about it.
    """

    def __init__(self, what: str, finding: str, rule: str = "", remedy: str = "") -> None:
        self.what, self.finding, self.rule, self.remedy = what, finding, rule, remedy
        text = f"{what}: {finding}"
        if rule:
            text += f" ({rule})" if rule.startswith(_SUGGESTIONS) else f" (rule: {rule})"
        if remedy:
            text += f". {remedy[0].upper()}{remedy[1:]}"
        super().__init__(text)

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        return type(self), (self.what, self.finding, self.rule, self.remedy)


class InputError(UppliedError):
    """A file, manifest or log cannot become a correct record."""


class SettingsError(UppliedError):
    """A setting or argument is outside what is allowed."""


class RefusedError(UppliedError):
    """A plan is refused: the inputs are sound, but no honest plan follows from them."""


class CatalogError(UppliedError):
    """The catalog cannot be read or written as asked; nothing stored was changed."""
