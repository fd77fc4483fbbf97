"""Names of bags."""

import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_metadata
from pkm_core.recording.cycle import file_name
from support.recorded_cell import SAMPLES


@pytest.mark.parametrize(
    ('motion', 'name'),
    [
        ('four_dof_70ms', 'four_dof_70ms'),
        ('../../etc/passwd', '_.._etc_passwd'),
        ('.hidden', 'hidden'),
        ('kreis über 3 mm', 'kreis__ber_3_mm'),
        ('', 'motion'),
        ('a' * 300, 'a' * 80),
    ],
)
def test_motion_name_becomes_a_file_name(motion, name):
    assert file_name(motion) == name


def test_bag_of_a_motion_named_like_a_path_stays_in_folder(cell, tmp_path):
    cell.load(1, motion='../x\n')
    cell.run(1, 0)
    cell.finish(1, SAMPLES)
    path = cell.outcome().path
    assert path.parent == tmp_path
    assert read_metadata(path)['custom_data']['motion'] == '../x\n'


def test_bags_of_the_same_second_have_different_names(cell):
    cell.play(1, 0)
    first = cell.outcome().path
    cell.play(1, 0)  # generator and machine were both restarted
    second = cell.outcome().path
    assert first != second
    assert read_cycle(first).is_whole
    assert read_cycle(second).is_whole
