"""Serves the page of a played bag."""

import os
from contextlib import closing
from time import monotonic, sleep

from pkm_nodes.page.page import Page
from pkm_nodes.page.player import Player

# [1/s, wall] rate of updating the page
_RATE = 15.0


def play(path, host, port):
    """Show the bags at `path` at http://host:port until interrupted; errors of `Player` and `Page`."""
    os.nice(10)  # a cell on this computer goes first
    player = Player(path)
    with closing(Page(host, port)) as page:
        print(f'{page.address} plays {path}; Ctrl-C ends it', flush=True)
        while True:
            next_turn = monotonic() + 1.0 / _RATE
            for wish in page.wishes():
                player.fulfil(wish)
            player.advance()
            page.show(player.cell)
            sleep(max(0.0, next_turn - monotonic()))
