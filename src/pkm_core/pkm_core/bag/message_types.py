"""Definitions of ROS messages without ROS: the installed ones, and those stored in a bag."""

from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pkm_core.config import install_prefixes
from pkm_core.errors import BagError


@cache
def typestore():
    """Return the message types of ROS 2 Jazzy and pkm_interfaces."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for prefix in install_prefixes():
        folder = prefix / 'share' / 'pkm_interfaces' / 'msg'
        if folder.is_dir():
            for path in sorted(folder.glob('*.msg')):
                store.register(get_types_from_msg(path.read_text(encoding='utf-8'), f'pkm_interfaces/msg/{path.stem}'))
            return store
    raise BagError(
        f'pkm_interfaces is not built in any of {[str(p) for p in install_prefixes()]}; run bringup_scripts/setup'
    )


def types_of(schemas):
    """
    Return the message types defined by the MCAP `schemas` of a bag; they may be older than the installed ones.

    Raises
    ------
    BagError
        If a definition is none; the type is named.

    """
    return _types(frozenset((schema.name, schema.data) for schema in schemas))


@cache  # the bags of a run have the same types, and a typestore compiles its readers
def _types(definitions):
    store = get_typestore(Stores.EMPTY)
    for name, text in sorted(definitions):
        try:
            store.register(get_types_from_msg(text.decode(), name))
            store.get_msgdef(name)
        except Exception as error:  # rosbags raises whatever the odd text leads to
            reason = ' '.join(str(error).split())[:100]
            raise BagError(f'{name}: its definition in the bag cannot be used: {reason}') from None
    return store
