"""`pkm page`: the live page of a running cell, or of recorded bags."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.interrupts import interruptible
from pkm_core.verbs.options import NamespaceOption
from pkm_nodes.graph import NAMESPACE, clock_of, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer


def page(
    port: Annotated[int, typer.Option(min=1, max=65535, help='TCP port of the page.')] = 8080,
    host: Annotated[
        str, typer.Option(help='Address to listen on; 0.0.0.0 lets other computers view and operate the cell.')
    ] = '127.0.0.1',
    namespace: NamespaceOption = NAMESPACE,
    bag: Annotated[
        Path | None, typer.Option(help='Play this bag, or the bags of this folder or run; no cell is needed.')
    ] = None,
):
    """
    Show the running cell in a browser: 3D view, errors, currents and nodes; buttons run, jog, stop, reset.

    Attaches to the cell of this ROS_DOMAIN_ID, for example that of `pkm run`; the cell may start later. With --bag it
    plays recorded cycles at any pace, with pause and scrub.

    Example: `pkm page --port 8080`

    Example: `pkm page --namespace left --port 8081`
    """
    namespace = namespace_of(namespace)
    if bag is not None:
        from pkm_nodes.page.play import play

        with interruptible():
            play(bag, host, port)
        return
    discover_on_this_computer()
    from pkm_nodes.nodes.dashboard import show

    show(page_arguments(port, host, namespace))


def page_arguments(port, host, namespace=NAMESPACE):
    """Return the ROS arguments of the node; the host is quoted, because `::1` and an empty text are no plain YAML."""
    quoted = host.replace("'", "''")
    moved = [word for rule in (('__ns', namespace), *clock_of(namespace)) for word in ('-r', ':='.join(rule))]
    return ['--ros-args', *moved, '-p', f'port:={port}', '-p', f"host:='{quoted}'"]
