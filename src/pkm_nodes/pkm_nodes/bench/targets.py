"""Targets of the bench: each figure, its bound, and whether it was met."""

from dataclasses import dataclass
from statistics import median

from pkm_core.machines import load_machine
from pkm_nodes.bench.subjects import MACHINE

# cycles per goal between two measurements of the memory
MEMORY_STEP = 50


@dataclass(frozen=True)
class Target:
    """A figure and its bound; `value` is None if it was not measured."""

    name: str
    value: float | None
    bound: float
    at_least: bool
    unit: str = ''

    @property
    def met(self):
        """Whether the figure meets its bound; None if it was not measured."""
        if self.value is None:
            return None
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def ratios(turns):
    """
    Return the ratios of speed between subjects, by ticks per second of wall time and by processor time per tick.

    `turns` is {subject: {'ticks_per_second': [value of each turn], ...}}. A ratio is the median over the turns; as
    subjects took turns, other load affected both sides. It is above 1 where the first subject is faster.
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
    Return the growth of the memory [MB] over the last four fifths of the series, or None if the series is too short.

    In the first fifth pools and queues reach their size. The values at both ends are means of a tenth of the series.
    """
    settled = memory[len(memory) // 5 :]
    if len(settled) < 4:
        return None
    end = max(1, len(memory) // 10)
    return sum(settled[-end:]) / end - sum(settled[:end]) / end


def targets(turns, memory):
    """Return the `Target`s for the `turns` of the subjects and the `memory` [MB], one value per MEMORY_STEP cycles."""
    real_time = 1.0 / load_machine(MACHINE).sample_time
    ratio = {name: pair['ticks_per_second'] for name, pair in ratios(turns).items()}

    def best(subject):
        return max(turns[subject]['ticks_per_second']) / real_time if subject in turns else None

    def cost(name):
        return 100 * (1 - ratio[name]) if name in ratio else None

    reached = min(turns['pace']['reached']) if 'pace' in turns else None
    delivery = [ms for turn in turns['composed']['delivery_ms'] for ms in turn] if 'composed' in turns else []
    return [
        Target('composed cell / bare floor', ratio.get('composed / floor'), 0.6, at_least=True),
        Target('composed cell, best turn', best('composed'), 1.5, at_least=True, unit='x real time'),
        Target('pace reached at pace 1.0, worst turn', reached, 0.99, at_least=True),
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
