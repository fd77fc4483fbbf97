"""Quantities as text: the whole text is one number and one unit, or it is refused by what stands in the way."""

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.quantities import QuantityError, scale, split, to_si


@pytest.mark.parametrize(
    ('text', 'unit', 'value'),
    [
        *[('5 mm', 'm', 5e-3), ('5mm', 'm', 5e-3), (' 5 mm ', 'm', 5e-3), ('-.5 mm', 'm', -0.5e-3)],
        *[('1e3 um', 'm', 1e-3), ('50 %', '', 0.5), ('3', '', 3.0), ('0 mm', 'm', 0.0), ('0.5 mm', 'm', 0.5e-3)],
        *[
            ('16 1/s', '1/s', 16.0),
            ('14 V s/mm', 'V s/m', 14e3),
            ('3 kg m^2', 'kg m^2', 3.0),
            ('2 V/(mm s)', 'V/(m s)', 2e3),
        ],
    ],
)
def test_quantity_is_read_in_si(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('1,5 mm', 'decimal comma'),
        ('70,5 ms', 'decimal comma'),
        ('-45,5 deg', 'decimal comma'),
        ("1'000 mm", 'separator between digits'),
        ('1_000 mm', 'separator between digits'),
        ('010 mm', "leading zero; write '10'"),
        ('080 ms', "leading zero; write '80'"),
        ('5 +- 1 mm', "'.- 1 mm' is not a unit"),
        ('0.5 mm @ 20', "'mm @ 20' is not a unit"),
        ('1.5.2 mm', "'.2 mm' is not a unit"),
        ('2 foo', "'foo' is not a known unit"),
        ('5 mm/s', 'has the dimension of millimeter / second; expected one of m'),
        ('nan mm', 'is not a quantity'),
        ('', 'is not a quantity'),
        ('5' * 100_000, r'^.{80,110}is not a quantity'),
    ],
)
def test_text_that_could_be_misread_is_refused(text, reason):
    """Each was read in silence before, most of them as another number."""
    with pytest.raises(QuantityError, match=reason.replace('.- 1', r'\+- 1')):
        to_si(text, 'm')


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_number_comes_back_as_written(number):
    assert split(f'{number!r} mm') == (number, 'mm')


@given(st.from_regex(r'\d{1,3}[^\d\s]\d{1,3} ?mm', fullmatch=True))
def test_digits_parted_by_a_sign_are_one_number_or_refused(text):
    """Only a point and an exponent may stand between digits."""
    try:
        number, _ = split(text)
    except QuantityError:
        return
    assert number == float(text.removesuffix('mm'))


@pytest.mark.parametrize(('text', 'factor'), [('V', 1.0), ('0.2 um', 2e-7), ('1/s', 1.0), ('%', 0.01), ('1', 1.0)])
def test_scale_of_a_unit_is_its_factor_to_si(text, factor):
    assert scale(text)[0] == pytest.approx(factor, rel=1e-15)


def test_unit_with_an_offset_is_no_scale():
    with pytest.raises(QuantityError, match='has an offset'):
        scale('degC')


@pytest.mark.parametrize('state', ['cut', 'read_only'])
def test_broken_cache_of_units_does_not_spoil_a_quantity(state, tmp_path):
    """The library of units keeps a cache in the user's folder, which may be cut short or not writable."""
    program = "from pkm_core.quantities import to_si; print(to_si('5 mm', 'm'))"
    environment = {'XDG_CACHE_HOME': str(tmp_path), 'HOME': str(tmp_path), 'PATH': ''}

    def run():
        return subprocess.run(
            [sys.executable, '-c', program], env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    if state == 'cut':
        assert run().stdout == '0.005\n'
        files = [path for path in tmp_path.rglob('*') if path.is_file()]
        assert files
        for path in files:
            path.write_bytes(path.read_bytes()[:20])
    else:
        (tmp_path / 'pint').write_text('a file where the folder of the cache would be')
    done = run()
    assert (done.stdout, done.stderr) == ('0.005\n', '')
