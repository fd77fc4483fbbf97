"""What stands around the machine in its tests."""

from pkm_interfaces.msg import CycleEvent, EncoderSample, MotorCommand

JOINTS = ('d1', 'd3', 'd5', 'd7')
# [s, wall] in which this process answers also on a busy machine, and not so long that waiting for its end hurts
IN_TIME = 1.0


class Controllers:
    """The test in the place of the joint controllers: loads cycles, hears samples, answers when and what it likes."""

    def __init__(self, graph):
        self._graph = graph
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._commands = {joint: graph.publisher(MotorCommand, f'{joint}/command') for joint in JOINTS}
        self.samples = {joint: graph.listen(EncoderSample, f'{joint}/encoder') for joint in JOINTS}

    def load(self, cycle, samples, joints=JOINTS, hold=0):
        """Announce `cycle` and report it as loaded by `joints`; `samples` is its length, or the lengths by joint."""
        self._events.publish(CycleEvent(event=CycleEvent.ANNOUNCED, cycle=cycle))
        self.load_only(cycle, samples, joints, hold)

    def load_only(self, cycle, samples, joints=JOINTS, hold=0):
        """Report `cycle` as loaded, without a goal; with `hold` it is a jog, or the next piece of one."""
        for joint in joints:
            length = samples[joint] if isinstance(samples, dict) else samples
            loaded = {'event': CycleEvent.LOADED, 'samples': length, 'hold': hold}
            self._events.publish(CycleEvent(source=joint, cycle=cycle, **loaded))

    def wait_for(self, tick, mode=EncoderSample.RUN):
        self._graph.spin_until(
            lambda: all(heard and heard[-1].tick >= tick for heard in self.samples.values()), f'samples of tick {tick}'
        )
        assert {(heard[-1].tick, heard[-1].mode) for heard in self.samples.values()} == {(tick, mode)}

    def answer(self, tick, volts=0.0, joints=JOINTS):
        for joint in joints:
            self._commands[joint].publish(MotorCommand(tick=tick, voltage=volts))

    def send(self, joint, data):
        """Publish these bytes as a command of `joint`."""
        self._commands[joint].publish(data)

    def run(self, first, ticks, volts=0.0):
        """Answer `ticks` ticks from tick `first` on."""
        for tick in range(first, first + ticks):
            self.wait_for(tick)
            self.answer(tick, volts)

    def counts(self):
        return {joint: [sample.counts for sample in heard] for joint, heard in self.samples.items()}
