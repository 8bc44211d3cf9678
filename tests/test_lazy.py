"""A cached property that lets threads compute for different instances at once."""

from __future__ import annotations

import threading

from lithoform.lazy import cached_property


class Slow:
    calls = 0

    def __init__(self, barrier: threading.Barrier | None = None) -> None:
        self.barrier = barrier

    @cached_property
    def value(self) -> int:
        """Documented."""
        self.calls += 1
        if self.barrier is not None:
            self.barrier.wait(10)
        return 7


def test_it_is_computed_once_and_kept_in_the_instance():
    one = Slow()
    assert (one.value, one.value, one.calls) == (7, 7, 1)
    assert Slow.value.__doc__ == "Documented."
    assert "value" in vars(one)


def test_two_instances_are_computed_at_once():
    # With one lock for both the first would wait for the second until the barrier breaks.
    barrier = threading.Barrier(2)
    found = []
    threads = [threading.Thread(target=lambda: found.append(Slow(barrier).value)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [7, 7]
