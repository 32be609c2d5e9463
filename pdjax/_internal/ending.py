"""The ending of a solver or of a run: an enumeration whose members are small integers with a reason in words."""

import enum
from typing import TypeVar

Member = TypeVar("Member", bound="Ending")


class Ending(enum.IntEnum):
    """Base class of the enumerations. A member is `NAME = number, "reason"`. Traced results hold the number."""

    reason: str

    def __new__(cls, number: int, reason: str) -> "Ending":
        """Make a member from its number and its reason."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.reason = reason
        return member

    @classmethod
    def of(cls: type[Member], number: int) -> Member:
        """The member with this number."""
        return next(member for member in cls if member == number)
