"""Python classes of ROS interfaces, found by the name of their type. Needs no rclpy."""

import importlib

_KINDS = {  # kind: (its name in messages, members that its classes have)
    'msg': ('message', ['SLOT_TYPES']),
    'srv': ('service', ['Request', 'Response']),
    'action': ('action', ['Goal', 'Result', 'Feedback']),
}


def find_interface(type_name, kind):
    """
    Return the Python class of an interface.

    Parameters
    ----------
    type_name : str
        'package/Name' or 'package/kind/Name'.
    kind : str
        'msg', 'srv' or 'action'.

    Raises
    ------
    RuntimeError
        If no installed package has it.

    """
    word, members = _KINDS[kind]
    parts = type_name.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    try:
        interface = getattr(importlib.import_module('.'.join(parts[:-1])), parts[-1])
    except (AttributeError, ImportError, TypeError, ValueError):
        interface = None
    if not all(hasattr(interface, member) for member in members):
        raise RuntimeError(f'The passed {word} type is invalid')
    return interface
