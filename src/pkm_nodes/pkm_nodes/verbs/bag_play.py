"""`pkm bag-play`: replay the messages of a bag."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.bag.reader import raw_messages
from pkm_core.errors import BagError
from pkm_core.interrupts import interruptible
from pkm_core.verbs.console import Output
from pkm_nodes.runtime.discovery import discover_on_this_computer


def bag_play(
    path: Annotated[Path, typer.Argument(help='Folder of a bag, or its MCAP file.')],
    rate: Annotated[float, typer.Option(min=1e-3, help='Simulated seconds per second.')] = 1.0,
    loop: Annotated[bool, typer.Option('--loop', help='Restart at the end of the bag, until interrupted.')] = False,
):
    """
    Publish the messages of a bag on their topics at the recorded times, with /clock.

    Topics that a running node publishes are not replayed: a running state estimator computes its own poses. A running
    cell is refused.

    Example: `pkm bag-play runs/first/bags/four_dof_70ms_0001_20260101T120000 --rate 0.5`
    """
    messages = list(raw_messages(path))
    if not messages:
        raise BagError(f'{path}: has no messages')
    discover_on_this_computer()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from pkm_nodes.clients.bag_player import BagPlayer

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)  # a signal raises `Interrupted`
    try:
        with interruptible():
            _play(BagPlayer, rclpy.create_node('bag_player', namespace='pkm'), messages, rate, loop)
    finally:
        rclpy.shutdown()


def _play(player_type, node, messages, rate, loop):
    """Play the messages once, or with `loop` until interrupted."""
    console = Output()
    with console.status('looking for subscriptions'):
        player = player_type(node, messages)
    for topic, owners in player.left_out.items():
        console.plain(f'{topic} is left to {", ".join(owners)}')
    subscriptions = sum(publisher.get_subscription_count() for publisher in player.publishers.values())
    console.plain(f'playing {len(player.publishers)} topics to {subscriptions} subscriptions')
    simulated = (messages[-1][3] - messages[0][3]) * 1e-9
    while True:
        seconds = player.play(rate)
        console.plain(f'{simulated:.3f} s of simulated time in {seconds:.3f} s')
        if not loop:
            return
