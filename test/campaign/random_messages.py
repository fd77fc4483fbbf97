"""Random ROS messages of any type, valid and not."""

from array import array

from pkm_nodes.messages.interfaces import find_interface

TEXTS = [
    '',
    'd1',
    'd9',
    'four_dof_70ms',
    'fourier_pid',
    'none',
    '/etc/passwd',
    '../x.yaml',
    '/dev/zero',
    'a' * 5000,
    '\n',
]
NUMBERS = [0.0, 1e-9, -1e-3, 3e-3, 1.0, -100.0, 1e300, float('inf'), float('-inf'), float('nan')]


def _whole(draw, low, high):
    """Return an integer: one of the extremes, a small one, or any."""
    return draw.choice([low, high, max(low, 1), max(low, 2), draw.randint(low, high)])


def random_value(draw, type_name):
    """Return a random value of a field of the ROS type `type_name`, e.g. 'uint32' or 'sequence<double>'."""
    if type_name.startswith('sequence<'):
        inner = type_name[len('sequence<') : -1].split(',')[0]
        return [random_value(draw, inner) for _ in range(draw.choice([0, 1, 4, 40]))]
    if type_name.endswith(']'):
        inner, _, length = type_name[:-1].rpartition('[')
        return [random_value(draw, inner) for _ in range(int(length))]
    if type_name in ('float', 'double'):
        return draw.choice([*NUMBERS, draw.gauss(0.0, 1.0)]) if type_name == 'double' else draw.gauss(0.0, 1.0)
    if type_name == 'boolean':
        return draw.random() < 0.5
    if type_name in ('octet', 'char'):
        return bytes([draw.randrange(256)]) if type_name == 'octet' else draw.randrange(128)
    if type_name.startswith(('int', 'uint')):
        bits = int(type_name.removeprefix('u').removeprefix('int'))
        signed = not type_name.startswith('u')
        return _whole(draw, -(1 << (bits - 1)) if signed else 0, (1 << (bits - signed)) - 1)
    if type_name.startswith(('string', 'wstring')):
        return draw.choice(TEXTS)
    return random_message(draw, find_interface(type_name, 'msg'))


def random_message(draw, message_type, **known):
    """Return a message of `message_type` with random fields; half of those in `known` have its value."""
    message = message_type()
    for name, type_name in message_type.get_fields_and_field_types().items():
        given = name in known and draw.random() < 0.5
        value = known[name] if given else random_value(draw, type_name)
        if isinstance(getattr(message, name), array):
            value = array(getattr(message, name).typecode, value)
        setattr(message, name, value)
    return message


def damaged(draw, data):
    """Return the serialized message `data` cut, flipped, of the other byte order, or empty."""
    data = bytearray(data)
    way = draw.randrange(5)
    if way == 0:
        return bytes(data[: draw.randrange(len(data))])
    if way == 1:
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif way == 2:
        data[1] ^= 1  # byte order of the CDR header
    elif way == 3:
        return b''
    else:
        data += bytes(draw.randrange(256) for _ in range(draw.randrange(64)))
    return bytes(data)
