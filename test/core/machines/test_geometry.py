"""Geometry of a machine: its hash, and its exchange for that of another machine file."""

import pytest

from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.machines.geometry import load_geometry
from pkm_core.recording.provenance import machine_hash

DRAWN, STAGE = load_geometry('planar'), load_geometry('xy_stage')
BUILT = """
built:
  specimen: {machine: planar, origin: simulated, seed: 1, environment: nominal}
  l2: 70.013 mm
  l4: 69.991 mm
  dy: 10.004 mm
  marks: {d1: 0.002 mm, d3: -0.001 mm}
"""


def replaced(old, new):
    return (DRAWN.text + BUILT).replace(old, new)


def test_exchanged_geometry_is_that_of_the_loaded_file(tmp_path):
    file = tmp_path / 'planar.yaml'
    file.write_text(DRAWN.text + BUILT)
    found = DRAWN.exchanged(file, file.read_text())
    assert found.machine.config == load_machine(file).config
    assert found.digest == load_geometry(file).digest
    assert found.file_hash == machine_hash(file)
    assert (DRAWN.is_calibrated, found.is_calibrated) == (False, True)
    assert found.exchanged('planar', DRAWN.text).digest == DRAWN.digest


def test_digest_follows_numbers_and_not_comments():
    assert DRAWN.exchanged('planar', DRAWN.text + '# edited\n').digest == DRAWN.digest
    built = DRAWN.exchanged('planar', DRAWN.text + BUILT).digest
    assert DRAWN.exchanged('planar', replaced('69.991', '69.992')).digest != built != DRAWN.digest


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: [', 'given.yaml: line 1: '),
        ('[1, 2]', "given.yaml: mechanism: None given; expected 'planar', as planar has"),
        (STAGE.text, "mechanism: 'xy_stage' given; expected 'planar'"),
        (replaced('r2: 43 mm', 'r2: 44 mm'), 'geometry differs from that of planar in this cell'),
        (replaced('encoder_resolution: 0.2', 'encoder_resolution: 0.1'), 'encoder_resolution differs'),
        (replaced('70.013 mm', '72 mm'), 'built.l2 72 mm; allowed 69 to 71 mm'),
        (replaced('70.013 mm', '.nan mm'), 'built.l2: '),
        (replaced('70.013 mm', '70.013'), 'built.l2: 70.013 has no unit'),
        (replaced('{machine: planar,', '{machine: four_dof,'), 'lengths of four_dof, seed 1, environment nominal'),
    ],
)
def test_file_of_another_machine_is_refused(text, reason):
    with pytest.raises(ConfigError, match=r'given\.yaml') as refusal:
        DRAWN.exchanged('given.yaml', text)
    assert reason in str(refusal.value)
