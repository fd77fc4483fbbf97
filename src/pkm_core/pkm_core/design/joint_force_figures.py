"""The figure of `pkm joint-forces`: loads of all joints over time."""

import numpy as np

from pkm_core.design.joint_forces import loads
from pkm_core.plotting import new_figure, save


def _is_vertical(joint):
    return any(link in joint.name for link in ('link 9', 'link 10', 'link 11', 'link 12'))


_PANELS = (
    ('guides', lambda joint: joint.kind == 'guide'),
    ('revolute joints of the planar links', lambda joint: joint.kind == 'revolute' and not _is_vertical(joint)),
    ('revolute joints of the vertical links', lambda joint: joint.kind == 'revolute' and _is_vertical(joint)),
)


def draw_joint_forces(folder, found, sample_time):
    """Draw force along, force across and moment of each joint of a `JointForces` into folder/joint_forces.png."""
    rows = [(title, [i for i, joint in enumerate(found.joints) if wanted(joint)]) for title, wanted in _PANELS]
    rows = [(title, chosen) for title, chosen in rows if chosen]
    figure = new_figure(13.0, 2.8 * len(rows) + 0.6)
    panels = np.atleast_2d(figure.subplots(len(rows), 3, sharex=True))
    time = 1e3 * sample_time * np.arange(len(found.reactions))
    for line, (title, chosen) in zip(panels, rows, strict=True):
        for i in chosen:
            values = loads(found.joints[i], found.reactions[:, i])
            for axes, value in zip(line, values.T, strict=True):
                axes.plot(time, value, linewidth=1.0, label=found.joints[i].name)
        for axes, label in zip(line, ('along [N]', 'across [N]', 'moment [N m]'), strict=True):
            axes.set(ylabel=label)
            axes.grid(alpha=0.3)
        line[1].set_title(title, fontsize='medium')
        line[2].legend(fontsize='x-small', loc='upper left', bbox_to_anchor=(1.0, 1.0))
    for axes in panels[-1]:
        axes.set_xlabel('time [ms]')
    save(figure, folder, 'joint_forces')
