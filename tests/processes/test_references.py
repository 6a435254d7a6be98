"""Values for another process: what is known there stays where it is."""

from dataclasses import dataclass

import numpy as np
from numpy.testing import assert_array_equal

from steelyard.processes.references import packed, unpacked


@dataclass(frozen=True, eq=False)
class Large:
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Small:
    shared: Large
    own: np.ndarray


def test_what_is_known_does_not_travel():
    there, here = Large(np.zeros(100_000)), Large(np.ones(100_000))
    data = packed(Small(there, np.arange(3)), (there,))
    assert len(data) < 1000
    found = unpacked(data, (here,))
    assert found.shared is here
    assert_array_equal(found.own, np.arange(3))


def test_what_is_equal_but_another_travels():
    shared = Large(np.zeros(10))
    found = unpacked(packed(Small(shared, np.arange(3)), (Large(np.zeros(10)),)), (None,))
    assert_array_equal(found.shared.values, shared.values)


def test_nothing_known():
    assert unpacked(packed({"a": (1, 2.5)})) == {"a": (1, 2.5)}
