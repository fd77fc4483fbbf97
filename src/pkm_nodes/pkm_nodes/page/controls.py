"""Buttons: run a motion, pace, visit a pose, stop, reset. Each puts a wish into a queue; dashboard.py executes it."""

from math import ceil, degrees, floor, isfinite, radians

from pkm_core.config import read_yaml
from pkm_core.errors import PkmError
from pkm_core.learning import law_names
from pkm_core.machines.checks import ANGLES
from pkm_core.machines.reach import reach
from pkm_nodes.page.cell import Status

_FAVOURITE_LAW = 'fourier_pid'
_FASTEST = 3.0  # [1] end of the pace slider; 0 is as fast as possible
_STEP = 0.1  # [mm, deg] of the sliders


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


class RunControls:
    """Run a motion, stop, brake, reset; a button that has an effect in the present state is coloured."""

    def __init__(self, gui, machine, wish):
        motions, laws = motions_of(machine), ['none', *law_names()]
        with gui.add_folder('Run a motion'):
            motion = gui.add_dropdown('motion', motions or [''])
            law = gui.add_dropdown('law', laws, initial_value=_FAVOURITE_LAW if _FAVOURITE_LAW in laws else laws[0])
            cycles = gui.add_number('cycles', 6, min=1, max=1000, step=1)
            self._buttons = {
                'run': gui.add_button('Run'),
                'stop': gui.add_button('Stop after this cycle'),
                'brake': gui.add_button('Brake now'),
                'reset': gui.add_button('Reset after a fault'),
            }
        self._buttons['run'].on_click(lambda _: wish('run', motion.value, int(cycles.value), law.value))
        for name in ('stop', 'brake', 'reset'):
            self._buttons[name].on_click(lambda _, name=name: wish(name))

    def show(self, cell):
        """Colour the buttons by the state of the machine."""
        running, fault = cell.status == Status.RUNNING, cell.status == Status.FAULT
        colours = {
            'run': 'green' if cell.status == Status.STANDING else 'gray',
            'stop': 'orange' if running else 'gray',
            'brake': 'red' if running else 'gray',
            'reset': 'red' if fault else 'gray',
        }
        for name, colour in colours.items():
            if self._buttons[name].color != colour:
                self._buttons[name].color = colour


class PaceControls:
    """Pace, pause and step; hidden unless the machine offers them."""

    def __init__(self, gui, wish):
        self._paused, self._asked = False, 0.0
        self._folder = gui.add_folder('Pace', visible=False)
        with self._folder:
            marks = ((0.0, 'max'), (1.0, '1'), (_FASTEST, f'{_FASTEST:g}'))
            self._slider = gui.add_slider('x real time', 0.0, _FASTEST, 0.01, 0.0, marks=marks)
            self._pause, self._step = gui.add_button('Pause', color='gray'), gui.add_button('One step', color='gray')
            self._text = gui.add_html('')
        self._slider.on_update(lambda event: event.client and wish('pace', self._slider.value))
        self._pause.on_click(lambda _: wish('pause', not self._paused))
        self._step.on_click(lambda _: wish('step'))

    def show(self, cell):
        """Show pace and pause as the machine reports them."""
        pace = cell.pace
        if self._folder.visible != pace.offered:
            self._folder.visible = pace.offered
        if not pace.offered:
            return
        if self._asked != pace.asked:  # another client may have set it
            self._asked = pace.asked
            self._slider.value = min(pace.asked, _FASTEST)
        if self._paused != pace.paused:
            self._paused = pace.paused
            self._pause.label, self._pause.color = ('Continue', 'blue') if pace.paused else ('Pause', 'gray')
            self._step.color = 'blue' if pace.paused else 'gray'
        text = f'asked: {f"{pace.asked:g} x real time" if pace.asked else "as fast as possible"}'
        if isfinite(pace.reached):
            text += f'; reached: {pace.reached:.3g}'
        text = f'<div class="pkm muted" data-pace>{text}</div>'
        if text != self._text.content:
            self._text.content = text


class JogControls:
    """Sliders whose ends are the reach of each coordinate, the others as set."""

    def __init__(self, gui, machine, wish, on_aim):
        """Call `wish('visit', offsets)` with the button, `on_aim(offsets)` with every change of the pose to visit."""
        self._machine, self._on_aim = machine, on_aim
        with gui.add_folder('Jog: visit a pose, from home and back'):
            self._sliders = {name: self._add_slider(gui, name) for name in machine.coordinates}
            gui.add_button('Visit').on_click(lambda _: wish('visit', self.offsets()))
        self._limit()
        for slider in self._sliders.values():
            slider.on_update(lambda event, slider=slider: event.client and self._on_change(slider))

    def offsets(self):
        """Return {coordinate: offset from home [m, rad]}."""
        return {
            name: radians(slider.value) if name in ANGLES else 1e-3 * slider.value
            for name, slider in self._sliders.items()
        }

    def take(self, machine):
        """Use `machine`, the same one with other lengths."""
        self._machine = machine
        self._limit()

    def _on_change(self, slider):
        within = min(max(slider.value, slider.min), slider.max)  # the box beside it accepts any number
        if slider.value != within:
            slider.value = within
        self._limit()
        self._on_aim(self.offsets())

    def _limit(self):
        """Set the ends of every slider to what the machine reaches with the other offsets."""
        for name, ends in reaches(self._machine, self.offsets()).items():
            slider = self._sliders[name]
            low, high = min(ends[0], slider.value), max(ends[1], slider.value)
            if (slider.min, slider.max) != (low, high):
                slider.min, slider.max = low, high

    def _add_slider(self, gui, name):
        unit = 'deg' if name in ANGLES else 'mm'
        low, high = reaches(self._machine, dict.fromkeys(self._machine.coordinates, 0.0))[name]
        return gui.add_slider(f'{name} [{unit}]', min=low, max=high, step=_STEP, initial_value=0.0)


def reaches(machine, offsets):
    """
    Return {coordinate: (low, high)} in mm or deg from home, whole steps of a slider within the reach.

    Parameters
    ----------
    machine : pkm_core.machines.base.Machine
        Its travel and links.
    offsets : dict
        From home by coordinate [m, rad]; each is varied alone.

    """
    home = machine.forward(machine.home)
    pose = [x + offsets[name] for x, name in zip(home, machine.coordinates, strict=True)]
    found = {}
    for name, x in zip(machine.coordinates, home, strict=True):
        ends = [degrees(end - x) if name in ANGLES else 1e3 * (end - x) for end in reach(machine, pose, name)]
        low, high = ceil(ends[0] / _STEP - 1e-6), floor(ends[1] / _STEP + 1e-6)
        found[name] = (round(low * _STEP, 1), round(max(low, high) * _STEP, 1))
    return found
