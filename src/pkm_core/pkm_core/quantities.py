"""
Quantities as text: one number and one unit, `0.5 mm`, and nothing else.

The whole text must match. A decimal comma, a thousands separator, a leading zero, a tolerance or words behind the unit
are refused: pint reads `1,5 mm` as 15 mm and `010 mm` as 0 mm.
"""

import re
from functools import cache

_NUMBER = re.compile(r'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?', re.ASCII)
_POWER = r'(?:\^-?\d{1,2}|\*\*-?\d{1,2})?'
_NAME = rf'[A-Za-zµμΩ°%]+{_POWER}'
_PRODUCT = rf'{_NAME}(?: ?[*/ ] ?{_NAME})*'
_FACTOR = rf'(?:{_NAME}|\({_PRODUCT}\))'
_UNIT = re.compile(rf'(?:1/)?{_FACTOR}(?: ?[*/ ] ?{_FACTOR})*', re.ASCII)
_LEADING_ZERO = re.compile(r'[+-]?0\d')
_LONGEST = 80  # characters; no quantity needs more


class QuantityError(ValueError):
    """A text that is no quantity, or has another dimension than expected."""


@cache
def _registry():
    import pint  # takes 0.3 s to import; only texts with units need it

    try:
        registry = pint.UnitRegistry(cache_folder=':auto:')
        registry.Quantity(1.0, 'mm').to('m')
    except Exception:  # a cache that cannot be written, is full or holds a cut file: pint raises whatever pickle does
        return pint.UnitRegistry()
    return registry


def split(text):
    """
    Return (number, unit text) of the quantity `text`; the unit is '' for a pure number.

    Raises
    ------
    QuantityError
        If the whole text is not one number and at most one unit. The message names the cause.

    Examples
    --------
    >>> split('0.5 mm'), split('-2e-3 m/s^2'), split('3')
    ((0.5, 'mm'), (-0.002, 'm/s^2'), (3.0, ''))

    """
    shown = text if len(text) <= _LONGEST else f'{text[:_LONGEST]}...'
    stripped = text.strip()
    number = _NUMBER.match(stripped) if len(text) <= _LONGEST else None
    if number is None:
        raise QuantityError(f'{shown!r} is not a quantity; expected one number and its unit')
    rest = stripped[number.end() :]
    if _LEADING_ZERO.match(stripped):
        raise QuantityError(f'{shown!r} has a leading zero; write {stripped[: number.end()].lstrip("+-0") or "0"!r}')
    if re.match(r',\d', rest):
        raise QuantityError(f'{shown!r} has a decimal comma; write a point, and no separator between thousands')
    if re.match(r"['_’]\d", rest):
        raise QuantityError(f'{shown!r} has a separator between digits; write the digits without one')
    unit = rest.strip()
    if unit and not _UNIT.fullmatch(unit):
        raise QuantityError(f'{shown!r}: {unit[:_LONGEST]!r} is not a unit; expected one number and its unit')
    return float(number[0]), unit


def to_si(text, unit):
    """
    Return the quantity `text` in `unit`, an SI unit ('' for a pure number).

    Raises
    ------
    QuantityError
        If the text is no quantity, see `split`, its unit is unknown, or its dimension is another one.

    Examples
    --------
    >>> to_si('0.5 mm', 'm'), to_si('50 %', ''), to_si('14 mm/s^2/V', 'm/s^2/V')
    (0.0005, 0.5, 0.014)

    """
    import pint

    number, given = split(text)
    try:
        return float(_registry().Quantity(number, given or 'dimensionless').to(unit or 'dimensionless').magnitude)
    except pint.DimensionalityError as error:
        raise QuantityError(f'{text!r} has the dimension of {error.units1}; expected one of {unit or "1"}') from None
    except Exception:  # pint raises a dozen kinds for a unit it does not know
        raise QuantityError(f'{text!r}: {given!r} is not a known unit; expected e.g. {unit or "1"!r}') from None


def scale(text):
    """
    Return (factor to SI base units, dimensionality) of a unit, or of a quantity that serves as one ('0.2 um').

    Raises
    ------
    QuantityError
        If the text is no unit, or the unit has an offset as degC has.

    """
    number, unit = split(text if _NUMBER.match(text.strip()) and not text.strip().startswith('1/') else f'1 {text}')
    try:
        registry = _registry()
        if unit and registry.Quantity(2.0, unit).to_base_units() != 2.0 * registry.Quantity(1.0, unit).to_base_units():
            raise QuantityError(f'{text!r} has an offset; expected a unit that is 0 where the quantity is 0')
        found = registry.Quantity(number, unit or 'dimensionless').to_base_units()
        return float(found.magnitude), found.dimensionality
    except QuantityError:
        raise
    except Exception:  # pint raises a dozen kinds for a unit it does not know
        raise QuantityError(f"{text!r} is not a unit; expected e.g. 'V', 'N m' or '0.2 um'") from None
