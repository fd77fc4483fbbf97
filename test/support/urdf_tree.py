"""A reader of URDF that shares nothing with pkm_core: places, speeds and kinetic energy of the links of its tree."""

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np


def numbers(text):
    return np.array([float(part) for part in text.split()])


def rotation(axis, angle):
    """Return the matrix of a rotation by `angle` [rad] about the unit vector `axis` (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


@dataclass
class Moving:
    """A link in the base frame: rotation, origin [m], angular velocity [rad/s], velocity of the origin [m/s]."""

    R: np.ndarray
    p: np.ndarray
    w: np.ndarray
    v: np.ndarray


class UrdfTree:
    """The tree of the URDF `text`."""

    def __init__(self, text):
        self.robot = ElementTree.fromstring(text.encode())
        self.joints = {joint.find('child').get('link'): joint for joint in self.robot.findall('joint')}
        self.links = {link.get('name'): link for link in self.robot.findall('link')}
        (self.root,) = self.links.keys() - self.joints.keys()

    def place(self, positions, rates=None):
        """Return {link: Moving} at `positions` and `rates` of joints by name; a mimic joint follows its own."""
        found = {self.root: Moving(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))}
        while len(found) < len(self.links):
            new = {child for child, joint in self.joints.items() if joint.find('parent').get('link') in found}
            new -= found.keys()
            assert new, 'no tree: links without a way to the root'
            for child in new:
                found[child] = self._moved(found, self.joints[child], positions, rates or {})
        return found

    def _moved(self, found, joint, positions, rates):
        parent = found[joint.find('parent').get('link')]
        origin, rpy = (numbers(joint.find('origin').get(key)) for key in ('xyz', 'rpy'))
        turned = rotation((0, 0, 1), rpy[2]) @ rotation((0, 1, 0), rpy[1]) @ rotation((1, 0, 0), rpy[0])
        R, kind, mimic = parent.R @ turned, joint.get('type'), joint.find('mimic')
        name, factor = joint.get('name'), 1.0
        if mimic is not None:
            name, factor = mimic.get('joint'), float(mimic.get('multiplier'))
        position, rate = (0.0, 0.0) if kind == 'fixed' else (factor * positions[name], factor * rates.get(name, 0.0))
        axis = R @ (numbers(joint.find('axis').get('xyz')) if kind != 'fixed' else np.zeros(3))
        slide, turn = (1.0, 0.0) if kind == 'prismatic' else (0.0, 1.0)
        offset = parent.R @ origin + slide * position * axis
        return Moving(
            rotation(axis, turn * position) @ R if kind == 'continuous' else R,
            parent.p + offset,
            parent.w + turn * rate * axis,
            parent.v + np.cross(parent.w, offset) + slide * rate * axis,
        )

    def kinetic_energy(self, positions, rates):
        """Return the kinetic energy [J] of all links with an `inertial`."""
        energy = 0.0
        for name, link in self.place(positions, rates).items():
            inertial = self.links[name].find('inertial')
            if inertial is None:
                continue
            mass = float(inertial.find('mass').get('value'))
            values = {key: float(value) for key, value in inertial.find('inertia').attrib.items()}
            moments = np.array([[values[f'i{min(a, b)}{max(a, b)}'] for a in 'xyz'] for b in 'xyz'])
            v = link.v + np.cross(link.w, link.R @ numbers(inertial.find('origin').get('xyz')))
            w = link.R.T @ link.w
            energy += 0.5 * mass * v @ v + 0.5 * w @ moments @ w
        return energy
