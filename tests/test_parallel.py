"""Work over threads: in order, bounded, and stopped by the first fault."""

from __future__ import annotations

import threading

import pytest

from lithoform.parallel import in_order


def test_results_come_in_the_order_of_the_items_whatever_the_threads():
    release = threading.Event()

    def work(i: int) -> int:
        # The first item ends last.
        if i == 0:
            release.wait(10)
        if i == 2:
            release.set()
        return i * i

    assert list(in_order(work, range(50), threads=3)) == [i * i for i in range(50)]
    assert list(in_order(lambda i: i, range(5), threads=1)) == list(range(5))


def test_items_are_consumed_two_a_thread_ahead_of_the_results():
    taken = []

    def items():
        for i in range(100):
            taken.append(i)
            yield i

    results = in_order(lambda i: i, items(), threads=2)
    assert next(results) == 0
    assert len(taken) <= 2 * 2 + 1
    results.close()
    assert len(taken) <= 2 * 2 + 1


def test_a_fault_is_raised_in_its_place_and_ends_the_work():
    def work(i: int) -> int:
        if i == 3:
            raise ArithmeticError("three")
        return i

    results = in_order(work, range(1000), threads=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ArithmeticError, match="three"):
        next(results)
    assert list(results) == []


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2"])
def test_no_threads_is_an_error_before_any_work(threads):
    with pytest.raises(ValueError, match="at least one thread"):
        in_order(lambda i: i, [1], threads=threads)
