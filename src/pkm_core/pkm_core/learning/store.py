"""
Learned feedforward on disk, with its origin; loading it for another origin is refused.

One .npz file has the feedforward of a motion (N, n) [V] and, for the basis law, the parameters valid for all motions.
"""

import hashlib
import json
import os
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pkm_core.control.model import load_model
from pkm_core.errors import LearningError

_LARGEST = 100_000_000  # bytes; the longest cycle of four joints has 1.3 MB


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
        reference=digest_of(trajectory),
    )


def digest_of(trajectory):
    """Return 12 hex digits that change with the positions of `trajectory`."""
    return _digest(np.ascontiguousarray(trajectory.position).tobytes())


def design_hash(machine, gains):
    """Return 12 hex digits that change with the machine's design, its models or its gains {joint: gains}."""
    joints = {'control': gains, 'model': load_model(machine)}
    config = [machine.config.model_dump_json()]
    config += [  # a section that a file leaves out does not change the hash
        f'{kind} {joint} {each[joint].model_dump_json(exclude_none=True)}'
        for kind, each in joints.items()
        for joint in each
    ]
    return _digest('\n'.join(config).encode())


def save(path, learned):
    """
    Write a `Learned` to the file `path` (.npz), complete or not at all.

    Raises
    ------
    LearningError
        If the file cannot be written, or `path` is something else than a file of learned feedforward: that is kept.

    """
    path = Path(path)
    check_replaceable(path)
    text = json.dumps({'origin': asdict(learned.origin), 'parameters': learned.parameters})
    beside = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        try:
            with beside.open('xb') as file:
                np.savez_compressed(file, feedforward=learned.feedforward, text=np.array(text))
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise LearningError(f'{path}: cannot be written: {error.strerror}') from None


def check_replaceable(path):
    """Refuse a `path` that `save` would refuse: something else than a file of learned feedforward or a free place."""
    path = Path(path)
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise LearningError(f'{path}: is no regular file; nothing was written')
    if path.exists():
        read(path)  # refuses a file that is none of ours


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
    """
    Return the `Learned` in the file `path`, without a check of its origin.

    Raises
    ------
    LearningError
        If it is no regular file, unpacks to more than `_LARGEST`, or is not what `save` writes.

    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise LearningError(f'{path}: is no regular file')
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _LARGEST:
            raise LearningError(f'{path}: unpacks to {size / 1e6:.0f} MB; allowed {_LARGEST / 1e6:.0f} MB')
        with np.load(path) as data:
            feedforward, text = data['feedforward'], json.loads(str(data['text']))
        learned = Learned(Origin(**text['origin']), feedforward, text['parameters'])
    except OSError as error:
        raise LearningError(f'{path}: cannot be read: {error.strerror or error}') from None
    except LearningError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, EOFError, AttributeError) as error:
        raise LearningError(f'{path}: is not a file of learned feedforward: {str(error)[:200]}') from None
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, MemoryError, OverflowError) as error:
        # damaged, encrypted, of an unknown compression, with an array of terabytes, or nested too deeply
        raise LearningError(f'{path}: is not a file of learned feedforward: {str(error)[:200]}') from None
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
