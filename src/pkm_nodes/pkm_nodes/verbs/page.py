"""`pkm page`: the live page of a running cell."""

import os
from typing import Annotated

import typer


def page(
    port: Annotated[int, typer.Option(min=1, max=65535, help='Port of the page.')] = 8080,
    host: Annotated[
        str, typer.Option(help='Address to listen on; 0.0.0.0 lets other computers see and press buttons.')
    ] = '127.0.0.1',
):
    """
    Show the running cell in a browser: the machine moving, errors, currents, nodes; run, jog, stop, reset.

    Attaches to the cell of this ROS_DOMAIN_ID, now or whenever one starts, also to that of `pkm run`.

    Example: `pkm page --port 8080`
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    from pkm_nodes.nodes.dashboard import show

    show(['--ros-args', '-p', f'port:={port}', '-p', f'host:={host}'])
