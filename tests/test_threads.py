"""A plan holds linear algebra to one thread, whoever calls, and gives the threads back."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly
from upplied.threads import one_thread


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def two_threads():
    with threadpool_limits(2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("this BLAS knows one thread alone")
        yield


@pytest.mark.ci
def test_a_plan_computes_with_one_thread(two_threads):
    (cube,) = [one for one in sample_structures() if one.structure_id == "cube-v1"]
    numbers = []

    def memo(stage, record_type, key, compute):
        numbers.append(blas_threads())
        return compute()

    plan_transfer(fly(cube, "sides"), cube, cube, settings_for("baseline"), memo)
    assert numbers and all(threads == {1} for threads in numbers)
    assert blas_threads() == {2}


def test_the_last_of_several_gives_the_threads_back(two_threads):
    with one_thread():
        with one_thread(), ThreadPoolExecutor(1) as other:
            assert other.submit(blas_threads).result() == {1}
        assert blas_threads() == {1}
    assert blas_threads() == {2}


def test_threads_are_given_back_after_an_error(two_threads):
    with pytest.raises(ValueError, match="within"), one_thread():
        raise ValueError("within")
    assert blas_threads() == {2}
