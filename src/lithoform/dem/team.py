"""How many threads the engine works with."""

from __future__ import annotations

import math
from typing import Final

from lithoform.dem.arrays import CHUNK

__all__ = ["Team"]

# Every so many launches another number of threads is tried, for at least so many steps.
_TRIED: Final = 16
_CHUNK_OF_TRIAL: Final = 8


class Team:
    """How many threads to launch: the number that was the fastest lately.

    The result does not depend on it.  Threads that wait for one another lose when other programs have the processors,
    and with few blocks; so now and then another number is tried for a moment.
    """

    def __init__(self, most: int, blocks: int, *, fixed: bool) -> None:
        self.most = max(1, min(most, math.ceil(blocks / CHUNK)))
        numbers = {self.most} if fixed else {self.most, *(2**k for k in range(self.most.bit_length()))}
        self._pace = dict.fromkeys(sorted(n for n in numbers if n <= self.most), 0.0)
        self._launches = 0

    def choose(self, steps: int) -> tuple[int, int]:
        """Threads of the next launch, and its steps: fewer where a number is only tried."""
        numbers = list(self._pace)
        best = min(numbers, key=lambda n: (self._pace[n], -n))
        self._launches += 1
        if len(numbers) > 1 and self._launches % _TRIED == 0:
            tried = numbers[(self._launches // _TRIED) % len(numbers)]
            return tried, min(steps, max(_CHUNK_OF_TRIAL, steps // 16))
        return best, steps

    def note(self, threads: int, steps: int, seconds: float) -> None:
        """Take the pace of a launch into account; of very short ones only the overhead would be seen."""
        if steps >= _CHUNK_OF_TRIAL:
            former = self._pace[threads]
            now = seconds / steps
            self._pace[threads] = now if former == 0.0 else 0.5 * (former + now)
