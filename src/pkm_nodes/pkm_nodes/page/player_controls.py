"""Controls of a played bag: play and pause, pace, and the time within the cycle."""

_SLOWEST, _FASTEST = 0.01, 3.0  # [1] times real time
_TICKS = {'-10': -10, '-1': -1, '+1': 1, '+10': 10}


class PlayerControls:
    """Controls of a `Player` in the current container of a viser GUI; each calls `wish(name, *arguments)`."""

    def __init__(self, gui, player, wish):
        self._player, self._duration = player, 0.0
        with gui.add_folder('Bag'):
            self._play = gui.add_button('Pause', color='blue')
            self._time = gui.add_slider('time [ms]', 0.0, 1.0, 0.5, 0.0)
            ticks = gui.add_button_group('ticks', tuple(_TICKS))
            pace = gui.add_slider('x real time', _SLOWEST, _FASTEST, 0.01, player.pace)
        self._play.on_click(lambda _: wish('play'))
        self._time.on_update(lambda event: event.client and wish('seek', 1e-3 * self._time.value))
        ticks.on_click(lambda _: wish('tick', _TICKS[ticks.value]))
        pace.on_update(lambda event: event.client and wish('pace', pace.value))

    def show(self, _):
        """Show where the player is."""
        player = self._player
        label = 'Pause' if player.is_playing else 'Play'
        if self._play.label != label:
            self._play.label = label
        if player.duration != self._duration:
            self._duration = player.duration
            self._time.max = max(1.0, 1e3 * player.duration)
            self._time.value = 0.0
        time = round(1e3 * player.time, 1)
        if player.is_playing or abs(self._time.value - time) > 1.0:  # a slider that is dragged is left alone
            self._time.value = time
