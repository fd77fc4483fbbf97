"""What a user does with the time of the machine: its parameter `pace`, its services `pause` and `step`."""

from math import isnan
from time import monotonic

from rcl_interfaces.msg import SetParametersResult
from std_srvs.srv import SetBool

from pkm_core.errors import PkmError
from pkm_core.servo.cycle_run import CycleState
from pkm_core.servo.pace import PACE, Pace, checked_pace
from pkm_nodes.messages.diagnostics import LATENESS, PACE_ASKED, PACE_REACHED, PAUSED
from pkm_nodes.runtime.alarm import Alarm


class PaceControl:
    """
    The pace of the machine `node`.

    Parameters
    ----------
    node : PkmNode
    sample_time : float
        [s]

    Attributes
    ----------
    pace : Pace

    """

    def __init__(self, node, sample_time):
        self._node, self._where = node, f'{node.get_fully_qualified_name()}: pace'
        self.pace = Pace(sample_time, checked_pace(node.tunable('pace', 0.0, PACE), self._where))

    def serve(self, run, barrier, perform):
        """Take requests from now on: those of the `CycleRun` and `TickBarrier` whose actions `perform` performs."""
        self._run, self._barrier, self._perform = run, barrier, perform
        self._alarm = Alarm(self._node, self._on_turn)
        self._node.add_on_set_parameters_callback(self._on_set)
        self._node.add_post_set_parameters_callback(self._after_set)
        self._node.create_service(SetBool, 'machine/pause', self._on_pause)
        self._node.offer('machine/step', self._step)

    def await_turn(self):
        """Begin the current tick when it is due."""
        self._alarm.set(self.pace.due(self._barrier.tick))

    def _on_turn(self):
        self._perform(self._run.turn(self._barrier.tick, monotonic()))

    def _on_set(self, parameters):
        try:
            for each in parameters:
                if each.name == 'pace':
                    checked_pace(each.value, self._where)
        except PkmError as refusal:
            return SetParametersResult(successful=False, reason=str(refusal))
        return SetParametersResult(successful=True)

    def _after_set(self, parameters):
        for each in parameters:
            if each.name == 'pace':
                self._change(self.pace.set, each.value)

    def _change(self, change, *arguments):
        tick, now = self._barrier.tick, monotonic()
        change(*arguments, tick, now)
        self._perform(self._run.paced(tick, now))

    def _on_pause(self, request, response):
        before = self.pace.paused
        if request.data != before:
            self._change(self.pace.pause if request.data else self.pace.resume)
        again = ' already' if before == request.data else ''
        response.success = True
        response.message = f'{"paused" if request.data else "not paused"}{again}: {self._place()}'
        return response

    def _step(self):
        if not self.pace.paused:
            raise PkmError('the machine is not paused; call machine/pause with data: true first')
        if not self._run.is_running:
            raise PkmError(f'no cycle runs, the machine is {self._run.state.value}; a step is a tick of a cycle')
        behind = self.pace.step()  # steps before this one whose tick has not begun count too
        tick = self._barrier.tick + behind - (self._run.state is not CycleState.RUNNING)
        cycle = self._run.cycle
        self._perform(self._run.paced(self._barrier.tick, monotonic()))
        return f'tick {tick} of cycle {cycle}'

    def _place(self):
        run = self._run
        return f'tick {self._barrier.tick} of cycle {run.cycle}' if run.is_running else 'no cycle runs'

    def describe(self):
        """Return what the machine does, for people."""
        if self.pace.paused:
            return f'paused: {self._place()}; machine/pause with data: false continues'
        return 'cycle running' if self._run.is_running else 'standing'

    def values(self):
        """Return the values for the diagnostics."""
        pace, late = self.pace, self.pace.lateness()
        figures = [1e6 * late.mean, 1e6 * late.percentile_99, 1e6 * late.largest, 100 * late.share]
        return {
            PACE_ASKED: pace.factor,
            PACE_REACHED: _text(pace.reached(self._barrier.tick, monotonic()), 3),
            PAUSED: str(pace.paused).lower(),
            **{name: _text(figure, 2) for name, figure in zip(LATENESS, figures, strict=True)},
        }


def _text(figure, digits):
    return '' if isnan(figure) else f'{figure:.{digits}f}'
