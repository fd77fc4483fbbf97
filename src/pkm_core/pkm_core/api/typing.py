"""Types and checks that the modules of the public face share."""

import operator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pkm_core.errors import PkmError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
ComplexArray = NDArray[np.complex128]


def checked_array(where: str, values: Any, shape: tuple[int, ...], error: type[PkmError] = PkmError) -> Array:
    """
    Return `values` as a new array of floats.

    Raises
    ------
    PkmError
        Or `error`, if they are no numbers, have another shape than `shape`, or one is not finite.

    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise error(f'{where}: {type(values).__name__} given; expected an array of shape {shape}') from None
    if array.shape != shape:
        raise error(f'{where}: shape {array.shape} given; expected {shape}')
    if not np.isfinite(array).all():
        place = tuple(int(number) for number in np.argwhere(~np.isfinite(array))[0])
        raise error(f'{where}: {array[place]} at {list(place)}; expected finite numbers')
    return array


def checked_count(where: str, value: Any, least: int) -> int:
    """Return `value` as an int; `PkmError` if it is no whole number from `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        raise PkmError(f'{where}: {value!r} given; expected a whole number from {least}') from None
    if number < least:
        raise PkmError(f'{where}: {number} given; allowed from {least}')
    return number


def checked_joint(where: str, joint: str, joints: tuple[str, ...]) -> int:
    """Return the column of `joint`; `PkmError` if it is none of `joints`."""
    if joint not in joints:
        raise PkmError(f'{where}: joint {joint!r} given; known: {list(joints)}')
    return joints.index(joint)
