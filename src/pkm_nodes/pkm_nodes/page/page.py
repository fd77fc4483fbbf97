"""The page in the browser: a viser server with buttons on the left, the machine in the centre, charts on the right."""

import os
import socket
from contextlib import redirect_stdout
from errno import EACCES, EADDRINUSE, errorcode
from io import StringIO
from queue import Empty, SimpleQueue

import viser

from pkm_core.errors import PkmError
from pkm_nodes.page.controls import JogControls, PaceControls, RunControls
from pkm_nodes.page.cycle_panel import CyclePanel
from pkm_nodes.page.panels import nodes_html, notice_html, status_html
from pkm_nodes.page.player_controls import PlayerControls
from pkm_nodes.page.scene import VIEWS, Scene
from pkm_nodes.page.style import HEAD

# [px] width of the panels; 490 px of a window of 1200 px are left for the machine
_LEFT, _RIGHT = 315, 395

# errors that concern the port, not the address
_OF_PORT = (EACCES, EADDRINUSE)


class Page:
    """
    Serves the page until `close`; all browsers show the same state, and each may press buttons.

    Parameters
    ----------
    host, port
        Address and port of the server.

    Raises
    ------
    PkmError
        If the host is no address of this computer, or the port is not free.

    """

    def __init__(self, host, port):
        _check_free(host, port)
        self._wishes = SimpleQueue()  # filled in threads of viser; ROS is served in another one
        self._machine = None
        self._scene = self._jog = None
        self._parts = ()
        self._texts = {}
        with redirect_stdout(StringIO()):  # the caller prints the address
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self._server.scene.set_up_direction('+z')
        self._server.gui.configure_theme(
            show_logo=False, show_share_button=False
        )  # sharing opens a tunnel to the internet
        self._build(None)

    def wishes(self):
        """Return the buttons pressed since the last call, each (name, *arguments)."""
        found = []
        while True:
            try:
                found.append(self._wishes.get_nowait())
            except Empty:
                return found

    def show(self, cell):
        """Update the page from a `Cell` or a `Player`."""
        if cell.machine is not self._machine:
            self._take(cell.machine, cell.player)
        with self._server.atomic():
            if self._scene is not None:
                self._scene.show(cell)
            for part in self._parts:
                part.show(cell)
            for make, element in self._texts.items():
                text = make(cell)
                if text != element.content:
                    element.content = text

    @property
    def address(self):
        """The address to open in a browser on this computer."""
        host = self._server.get_host()
        return f'http://{f"[{host}]" if ":" in host else host}:{self._server.get_port()}'

    def close(self):
        """End the server; browsers keep the last picture and reconnect to the next server on this port."""
        self._server.stop()

    def _take(self, machine, player):
        """Show another machine; of the same one with other lengths only the drawing and the reach change."""
        if self._jog is None or machine is None or machine.name != self._machine.name:
            self._build(machine, player)
            return
        self._machine = machine
        self._server.scene.reset()
        self._draw()
        self._jog.take(machine)

    def _build(self, machine, player=None):
        """Build the page for `machine`, None without a cell, with the controls of `player` if there is one."""
        self._machine, self._scene, self._jog, self._parts = machine, None, None, ()
        gui = self._server.gui
        gui.reset()
        self._server.scene.reset()
        gui.set_panel_label('Cell' if machine is None else f'{"Cell" if player is None else "Bag"}: {machine.name}')
        gui.main_panel.dock_left()
        gui.main_panel.set_width(_LEFT)
        gui.add_html(HEAD)
        self._texts = {make: gui.add_html('') for make in (status_html, notice_html)}
        if machine is None:
            return
        self._draw()
        if player is None:
            controls = self._add_operation(gui, machine)
        else:
            controls = [PlayerControls(gui, player, self._wish)]
            self._add_views(gui)
        panel = gui.add_panel()
        cycles = CyclePanel(gui, panel, machine, self._wish)
        panel.dock_right()
        panel.set_width(_RIGHT)
        panel.expand()  # on a phone it would start closed
        self._parts = (*controls, cycles)

    def _add_operation(self, gui, machine):
        """Add the tabs of a cell; return what is to be updated."""
        tabs = gui.add_tab_group()
        with tabs.add_tab('Operate'):
            run, pace = RunControls(gui, machine, self._wish), PaceControls(gui, self._wish)
            self._jog = JogControls(gui, machine, self._wish, self._aim)
            self._add_views(gui)
        with tabs.add_tab('Nodes'):
            self._texts[nodes_html] = gui.add_html('')
        return [run, pace]

    def _aim(self, offsets):
        self._scene.aim(offsets)  # the scene is exchanged with the lengths of the machine

    def _add_views(self, gui):
        views = gui.add_button_group('view', tuple(VIEWS))
        views.on_click(lambda event: event.client and self._scene.place(event.client.camera, views.value))

    def _draw(self):
        self._scene = Scene(self._server.scene, self._server.initial_camera, self._machine)

    def _wish(self, *wish):
        self._wishes.put(wish)


def _check_free(host, port):
    """Refuse no host, and a port in use; viser would take the next one without a message."""
    if not host.strip():
        raise PkmError(f'page: host is {host!r}; expected an address of this computer, e.g. 127.0.0.1 or ::1')
    try:
        socket.create_server((host, port), family=socket.AF_INET6 if ':' in host else socket.AF_INET).close()
    except (OSError, OverflowError, ValueError, TypeError) as error:  # the last two: no host can have this name
        reason = os.strerror(error.errno) if getattr(error, 'errno', None) in errorcode else error
        advice = f'choose another with --{"port" if getattr(error, "errno", None) in _OF_PORT else "host"}'
        raise PkmError(f'page: cannot listen on {host} port {port}: {reason}; {advice}') from None
