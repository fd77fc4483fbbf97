"""The machine in three dimensions: the links of `pkm_core.machines.description` at their joint positions."""

import numpy as np

from pkm_core.machines.description import ROOT, TOOL, base_boxes, joint_positions, links, local_frame
from pkm_nodes.page.cell import home_pose

# [m] from the centre of the machine to the camera
_EYE = np.array([-0.335, -0.40, 0.29])
_FIELD_OF_VIEW = np.radians(44.0)
# views: direction from the machine to the camera, and what is up
VIEWS = {
    '3D': (_EYE / np.linalg.norm(_EYE), (0.0, 0.0, 1.0)),
    'top': ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    'front': ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    'side': ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
_RED = (214, 39, 40)


class Scene:
    """Draws one machine into the scene of a viser server."""

    def __init__(self, scene, camera, machine):
        self._scene = scene
        self._path = self._drawn = None
        self._positions = joint_positions(machine, machine.home)
        self._home = home_pose(machine)
        self._add_surroundings(camera)
        self._moving = []  # (link, its frame)
        paths = {ROOT: f'/{ROOT}'}
        scene.add_frame(paths[ROOT], axes_length=0.03, axes_radius=8e-4)
        self._add_boxes(paths[ROOT], base_boxes(machine))
        for link in links(machine):
            turn, origin = local_frame(link, self._positions)
            paths[link.name] = path = f'{paths[link.parent]}/{link.name}'
            frame = scene.add_frame(path, show_axes=False, wxyz=turn, position=origin)
            self._add_boxes(path, link.boxes)
            if link.variable:
                self._moving.append((link, frame))
        scene.add_icosphere(f'{paths[TOOL]}/tip', radius=2e-3, color=_RED)
        self._target = scene.add_frame('/target', axes_length=0.015, axes_radius=5e-4, visible=False)
        scene.add_icosphere('/target/tip', radius=3e-3, color=_RED, opacity=0.4)

    def show(self, cell):
        """Move the machine to the positions of `cell` and draw the path of its tool."""
        if cell.positions != self._positions:
            self._positions = cell.positions
            for link, frame in self._moving:
                if link.variable in cell.positions:
                    frame.wxyz, frame.position = local_frame(link, cell.positions)
        if cell.path is not self._drawn:
            self._drawn = cell.path
            self._draw_path(cell.path)

    def aim(self, offsets):
        """Show the pose at `offsets` from home; hide it at home."""
        pose = {name: self._home[name] + offset for name, offset in offsets.items()}
        half = 0.5 * pose.get('phi', 0.0)
        self._target.position = (pose['x'], pose['y'], pose.get('z', 0.0))
        self._target.wxyz = (np.cos(half), 0.0, 0.0, np.sin(half))
        self._target.visible = any(offsets.values())

    def place(self, camera, view='3D'):
        """Move the camera of one browser, or the initial one, to one of `VIEWS`."""
        direction, up = VIEWS[view]
        middle = np.array([self._home['x'], self._home['y'], 0.35 * self._home.get('z', 0.0)])
        camera.up = up
        camera.position, camera.look_at = middle + np.linalg.norm(_EYE) * np.array(direction), middle
        camera.fov = _FIELD_OF_VIEW

    def _add_surroundings(self, camera):
        floor = {'cell_size': 0.01, 'section_size': 0.05, 'shadow_opacity': 0.2}
        self._scene.add_grid('/floor', 0.4, 0.4, position=(0.1, 0.1, -0.021), **floor)
        self.place(camera)

    def _add_boxes(self, path, boxes):
        for number, box in enumerate(boxes):
            colour = tuple(round(255 * part) for part in box.colour)
            self._scene.add_box(f'{path}/{number}', colour, box.size, position=box.centre)

    def _draw_path(self, path):
        if self._path is not None:
            self._path.remove()
            self._path = None
        if path is None or len(path) < 2:
            return
        few = path[:: max(1, len(path) // 200)]
        segments = np.stack([few[:-1], few[1:]], axis=1)
        self._path = self._scene.add_line_segments('/path', segments, colors=_RED, thickness=8e-4)
