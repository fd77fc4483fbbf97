"""`pkm bag-play`: publish what a bag holds on its topics again."""

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pkm_core.bag.reader import raw_messages
from pkm_core.errors import BagError


def bag_play(
    path: Annotated[Path, typer.Argument(help='Folder of a bag, or its MCAP file.')],
    rate: Annotated[float, typer.Option(min=1e-3, help='Simulated seconds a second.')] = 1.0,
    loop: Annotated[bool, typer.Option('--loop', help='Begin again at the end, until interrupted.')] = False,
):
    """
    Publish the messages of a bag on their topics again, at their pace, with /clock.

    What a running node publishes itself is left to it: a state estimator that listens makes its own poses. A bag is not
    played into a running cell.

    Example: `pkm bag-play runs/first/bags/four_dof_70ms_0001_20260101T120000 --rate 0.5`
    """
    messages = list(raw_messages(path))
    if not messages:
        raise BagError(f'{path}: holds no message')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from pkm_nodes.clients.bag_player import BagPlayer

    console = Console()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C is a KeyboardInterrupt
    try:
        node = rclpy.create_node('bag_player', namespace='pkm')
        with console.status('looking for listeners'):
            player = BagPlayer(node, messages)
        for topic, owners in player.left_out.items():
            console.print(f'{topic} is left to {", ".join(owners)}', soft_wrap=True)
        subscriptions = sum(publisher.get_subscription_count() for publisher in player.publishers.values())
        console.print(f'playing {len(player.publishers)} topics to {subscriptions} subscriptions', soft_wrap=True)
        simulated = (messages[-1][3] - messages[0][3]) * 1e-9
        while True:
            seconds = player.play(rate)
            console.print(f'{simulated:.3f} s of simulated time in {seconds:.3f} s', soft_wrap=True)
            if not loop:
                return
    finally:
        rclpy.shutdown()
