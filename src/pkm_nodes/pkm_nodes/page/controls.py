"""Buttons: run a motion, visit a pose, stop, reset. Each puts a wish into a queue; dashboard.py executes it."""

from math import radians

from pkm_core.config import read_yaml
from pkm_core.errors import PkmError
from pkm_core.learning import law_names

_FAVOURITE_LAW = 'fourier_pid'


def motions_of(machine):
    """Return the names of the motions in config/motions that are for `machine`."""
    names = []
    for name in machine.configuration.names('motions'):
        try:
            if read_yaml(machine.configuration.find('motions', name)).get('machine') == machine.name:
                names.append(name)
        except PkmError:  # a file that is being written; the cell reports its error when it is run
            names.append(name)
    return names


class Controls:
    """Buttons and fields in the current container of a viser GUI."""

    def __init__(self, gui, machine, wish, on_aim):
        """Call `wish(name, *arguments)` with every button, `on_aim(offsets)` with every change of the pose to visit."""
        self._machine = machine
        motions, laws = motions_of(machine), ['none', *law_names()]
        with gui.add_folder('Run a motion'):
            motion = gui.add_dropdown('motion', motions or [''])
            law = gui.add_dropdown('law', laws, initial_value=_FAVOURITE_LAW if _FAVOURITE_LAW in laws else laws[0])
            cycles = gui.add_number('cycles', 6, min=1, max=1000, step=1)
            run = gui.add_button('Run', color='green')
            run.on_click(lambda _: wish('run', motion.value, int(cycles.value), law.value))
            gui.add_button('Stop after this cycle', color='orange').on_click(lambda _: wish('stop'))
            gui.add_button('Brake now', color='red').on_click(lambda _: wish('brake'))
            gui.add_button('Reset after a fault', color='gray').on_click(lambda _: wish('reset'))
        with gui.add_folder('Jog: visit a pose, from home and back'):
            self._offsets = {name: self._add_slider(gui, name) for name in machine.coordinates}
            for slider in self._offsets.values():
                slider.on_update(lambda _: on_aim(self.offsets()))
            gui.add_button('Visit').on_click(lambda _: wish('visit', self.offsets()))

    def offsets(self):
        """Return {coordinate: offset from home [m, rad]}."""
        return {
            name: radians(slider.value) if name == 'phi' else 1e-3 * slider.value
            for name, slider in self._offsets.items()
        }

    def _add_slider(self, gui, name):
        """Return a slider that extends beyond the workspace: the cell refuses poses out of reach."""
        span = 30.0 if name == 'phi' else 1e3 * float((self._machine.limits.upper - self._machine.limits.lower).max())
        unit = 'deg' if name == 'phi' else 'mm'
        return gui.add_slider(f'{name} [{unit}]', min=-span, max=span, step=0.1, initial_value=0.0)
