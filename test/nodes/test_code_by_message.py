"""A message names no code to run and no file to overwrite; folders for both are given at the start of the node."""

import pytest

from pkm_core.errors import PkmError
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode

CODE = """
from pathlib import Path
from pkm_core.learning.fourier import FourierLaw

Path(__file__).with_name('executed').touch()


class Law(FourierLaw):
    pass
"""


@pytest.fixture
def law(tmp_path):
    """Return a YAML file whose Python file leaves a trace when it is executed."""
    folder = tmp_path / 'laws'
    folder.mkdir()
    (folder / 'evil.py').write_text(CODE)
    file = folder / 'evil.yaml'
    file.write_text('law: evil.py:Law\nlead: 5\n')
    return file


def test_goal_executes_no_code_of_an_unknown_folder(graph, goals, law):
    graph.start(TrajectoryGeneratorNode)
    _, result = goals.result(goals.send(motion='four_dof_70ms', learning_law=str(law)))
    assert 'evil.py is not loaded; allowed folders: none' in result.message
    assert not (law.parent / 'executed').exists()


@pytest.mark.parametrize('place', ['../laws/evil.py:Law', '/laws/evil.py:Law'])
def test_allowed_folder_does_not_lead_to_another_one(graph, goals, law, tmp_path, place):
    allowed = tmp_path / 'allowed'
    allowed.mkdir()
    (allowed / 'sly.yaml').write_text(f'law: {place}\nlead: 5\n')
    graph.start(TrajectoryGeneratorNode, plugins=str(allowed))
    _, result = goals.result(goals.send(motion='four_dof_70ms', learning_law=str(allowed / 'sly.yaml')))
    assert 'expected a file in' in result.message
    assert not (law.parent / 'executed').exists()


def test_law_of_an_allowed_folder_is_executed(graph, goals, law):
    graph.start(TrajectoryGeneratorNode, plugins=f'/nowhere, {law.parent}')
    goals.result(goals.send(motion='four_dof_70ms', learning_law=str(law)))
    assert (law.parent / 'executed').exists()


@pytest.mark.parametrize('path', ['/etc/learned.npz', '../learned.npz', 'inside/../../learned.npz', 'link/learned.npz'])
def test_save_writes_into_the_folder_of_the_node_only(graph, tmp_path, path):
    folder = tmp_path / 'folder'
    folder.mkdir()
    (folder / 'link').symlink_to('/etc')
    node = graph.start(LearningNode, folder=str(folder))
    with pytest.raises(PkmError, match='allowed: files in the folder of the learning node'):
        node._allowed(path)
    assert node._allowed('learned.npz') == folder / 'learned.npz'
