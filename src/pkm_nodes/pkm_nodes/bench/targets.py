"""What the bench's figures must reach, and whether they do."""

from dataclasses import dataclass
from statistics import median

from pkm_core.machines import load_machine
from pkm_nodes.bench.subjects import MACHINE

# cycles a goal between two looks at the memory
MEMORY_STEP = 50


@dataclass(frozen=True)
class Target:
    """One line of the account: a figure, what it must be, and whether it is; `value` is None if it was not measured."""

    name: str
    value: float | None
    bound: float
    at_least: bool
    unit: str = ''

    @property
    def met(self):
        """Tell whether the figure is good enough; None if there is none."""
        if self.value is None:
            return None
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def ratios(turns):
    """
    Return the ratios of speed between subjects, by ticks per second of wall time and by processor time a tick.

    `turns` holds {'ticks_per_second': [of every turn], ...} by subject. Subjects took turns, so what else the computer
    did fell on both sides of a ratio; the median over the turns is taken. A ratio is above 1 where the first is faster.
    """
    pairs = {
        'composed / floor': ('composed', 'floor'),
        'composed / floor of bytes': ('composed', 'bytes'),
        'processes / naive': ('processes', 'naive'),
        'composed / processes': ('composed', 'processes'),
        'composed / without recorder': ('composed', 'alone'),
        'recorder and page / without': ('watched', 'alone'),
        'page / without': ('watched', 'composed'),
        'simulation / composed': ('simulation', 'composed'),
        'simulation / MuJoCo': ('simulation', 'mujoco'),
    }
    return {
        name: {
            'ticks_per_second': _median_ratio(turns, 'ticks_per_second', first, second),
            'processor_time': _median_ratio(turns, 'cpu_us_per_tick', second, first),
        }
        for name, (first, second) in pairs.items()
        if first in turns and second in turns
    }


def _median_ratio(turns, figure, first, second):
    return median(a / b for a, b in zip(turns[first][figure], turns[second][figure], strict=True))


def growth(memory):
    """
    Return by how much [MB] the memory has grown over the last four fifths of the series, or None if it is too short.

    The first fifth is left out: there pools and queues reach their size. Ends are means of a tenth of the series each.
    """
    settled = memory[len(memory) // 5 :]
    if len(settled) < 4:
        return None
    end = max(1, len(memory) // 10)
    return sum(settled[-end:]) / end - sum(settled[:end]) / end


def targets(turns, memory):
    """Return the list of `Target`s for the `turns` of the subjects and the `memory` [MB] every MEMORY_STEP cycles."""
    real_time = 1.0 / load_machine(MACHINE).sample_time
    ratio = {name: pair['ticks_per_second'] for name, pair in ratios(turns).items()}

    def best(subject):
        return max(turns[subject]['ticks_per_second']) / real_time if subject in turns else None

    def cost(name):
        return 100 * (1 - ratio[name]) if name in ratio else None

    delivery = [ms for turn in turns['composed']['delivery_ms'] for ms in turn] if 'composed' in turns else []
    return [
        Target('composed cell / bare floor', ratio.get('composed / floor'), 0.6, at_least=True),
        Target('composed cell, best turn', best('composed'), 1.5, at_least=True, unit='x real time'),
        Target('processes / naive executor', ratio.get('processes / naive'), 2.0, at_least=True),
        Target('recorder and page cost', cost('recorder and page / without'), 25.0, at_least=False, unit='%'),
        Target('page costs', cost('page / without'), 10.0, at_least=False, unit='%'),
        Target('simulation without ROS, best turn', best('simulation'), 50.0, at_least=True, unit='x real time'),
        Target(
            'trajectory to loaded controllers',
            median(delivery) if delivery else None,
            50.0,
            at_least=False,
            unit='ms',
        ),
        Target(
            f'memory growth over {len(memory) * MEMORY_STEP} cycles', growth(memory), 1.0, at_least=False, unit='MB'
        ),
    ]
