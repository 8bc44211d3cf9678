"""`cached_property` without a lock.

That of Python 3.11 holds one lock for all instances of a class while it computes, so that threads which measure
different meshes would take turns.  Without it two threads that ask the same instance at once may both compute; the
results are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

__all__ = ["cached_property"]

if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property:
        """An attribute that is computed when it is first read, and kept in the instance."""

        def __init__(self, function: Callable[[Any], Any]) -> None:
            self.function = function
            self.__doc__ = function.__doc__

        def __set_name__(self, owner: type, name: str) -> None:
            self.name = name

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            if instance is None:
                return self
            value = self.function(instance)
            # Not a data descriptor: from now on the instance's own entry is found first.
            instance.__dict__[self.name] = value
            return value
