"""
Learned feedforward on disk, with its origin; loading it for another origin is refused.

One .npz file has the feedforward of a motion (N, n) [V] and, for the basis law, the parameters valid for all motions.
"""

import hashlib
import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pkm_core.control.model import load_model
from pkm_core.errors import LearningError


@dataclass(frozen=True)
class Origin:
    """Conditions under which a learned feedforward is valid."""

    machine: str
    motion: str
    law: str
    sample_time: float  # [s]
    config: str  # hash of the machine's design, its models and its gains
    reference: str  # hash of the motion's joint positions


@dataclass(frozen=True)
class Learned:
    """Content of a file."""

    origin: Origin
    feedforward: np.ndarray  # (N, n) [V]
    parameters: dict[str, dict[str, float]]  # by joint and name, of the basis law; else empty


def origin_of(machine, motion, law, gains, trajectory):
    """Return the `Origin` for the law named `law` and the motion named `motion` with `trajectory` in joints."""
    return Origin(
        machine=machine.name,
        motion=motion,
        law=law,
        sample_time=machine.sample_time,
        config=design_hash(machine, gains),
        reference=_digest(np.ascontiguousarray(trajectory.position).tobytes()),
    )


def design_hash(machine, gains):
    """Return 12 hex digits that change with the machine's design, its models or its gains {joint: gains}."""
    joints = {'control': gains, 'model': load_model(machine)}
    config = [machine.config.model_dump_json()]
    config += [f'{kind} {joint} {each[joint].model_dump_json()}' for kind, each in joints.items() for joint in each]
    return _digest('\n'.join(config).encode())


def save(path, learned):
    """Write a `Learned` to the file `path` (.npz)."""
    text = json.dumps({'origin': asdict(learned.origin), 'parameters': learned.parameters})
    try:
        with Path(path).open('wb') as file:
            np.savez_compressed(file, feedforward=learned.feedforward, text=np.array(text))
    except OSError as error:
        raise LearningError(f'{path}: cannot be written: {error.strerror}') from None


def load(path, origin):
    """
    Return the feedforward (N, n) [V] in the file `path` for `origin`.

    Raises
    ------
    LearningError
        If the file cannot be read or has another origin; each difference is named. The law is not compared: the
        feedforward is valid under any law.

    """
    learned = read(path)
    _require(path, learned.origin, origin, ('machine', 'motion', 'sample_time', 'config', 'reference'))
    return learned.feedforward


def load_parameters(path, origin):
    """Return the {joint: {name: parameter}} in the file `path`; errors as `load`, with the law and any motion."""
    learned = read(path)
    _require(path, learned.origin, origin, ('machine', 'law', 'sample_time', 'config'))
    if not learned.parameters:
        raise LearningError(f'{path}: has no parameters; expected a file of the basis law')
    return learned.parameters


def read(path):
    """Return the `Learned` in the file `path`, without a check of its origin."""
    try:
        with np.load(Path(path)) as data:
            feedforward, text = data['feedforward'], json.loads(str(data['text']))
        learned = Learned(Origin(**text['origin']), feedforward, text['parameters'])
    except OSError as error:
        raise LearningError(f'{path}: cannot be read: {error.strerror or error}') from None
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise LearningError(f'{path}: is not a file of learned feedforward: {error}') from None
    if feedforward.ndim != 2 or feedforward.dtype != np.float64 or not np.isfinite(feedforward).all():
        raise LearningError(
            f'{path}: feedforward {feedforward.shape} {feedforward.dtype} given; expected finite float64 (N, n)'
        )
    return learned


def _require(path, found, wanted, fields):
    found, wanted = asdict(found), asdict(wanted)
    differences = [f'{name} {found[name]!r}, here {wanted[name]!r}' for name in fields if found[name] != wanted[name]]
    if differences:
        raise LearningError(f'{path}: was learned for another {"; ".join(differences)}')


def _digest(data):
    return hashlib.sha256(data).hexdigest()[:12]
