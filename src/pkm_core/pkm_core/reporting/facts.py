"""The settings of runs as tables with readable names."""

import json

from pkm_core.reporting.tables import Table

_NAMES = {  # of facts of a bag or of results.json
    'law': 'learning law',
    'learning_law': 'learning law',
    'control': 'controller',
    'learned': 'learned before, file',
    'without': 'without the nodes',
    'sample_time_s': 'sample time [s]',
    'config_hash': 'hash of the configuration',
    'geometry': 'hash of the geometry',
    'git_revision': 'revision of the project',
    'recorded_at': 'recorded at',
    'ticks_per_second': 'ticks per second of wall time',
    'ticks_per_second_in_cycles': 'the same, while moving',
    'end': 'end of each cycle',
}
# facts of a bag that are tables of their own, or account for its messages
_PARAMETERS = 'parameters'
_ACCOUNTS = ('lost', 'lost_ticks', 'surplus', 'learned_feedforward')


def facts_table(runs):
    """Return the table of the settings of the runs."""
    left_out = {_PARAMETERS, *_ACCOUNTS}
    keys = [key for key in dict.fromkeys(key for run in runs for key in run.facts) if key not in left_out]
    rows = [[name_of(key), *(_fact(run.facts.get(key, '')) for run in runs)] for key in keys]
    return Table('', ['', *(run.name for run in runs)], rows)


def parameters_table(run):
    """Return the table of the parameters of all nodes in the bags of a run; None if they are not recorded."""
    try:
        nodes = json.loads(run.facts.get(_PARAMETERS, ''))
        rows = [[node, key, _fact(value)] for node, values in nodes.items() for key, value in values.items()]
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None
    for earlier, row in zip(rows[-2::-1], rows[:0:-1], strict=True):
        if earlier[0] == row[0]:
            row[0] = ''  # a name begins a group
    return Table(f'{run.name}: parameters of the nodes', ['node', 'parameter', 'value'], rows)


def name_of(key):
    """Return a readable name of a fact."""
    return _NAMES.get(key, key.replace('_', ' '))


def _fact(value):
    if value is None or value == '':
        return '-'
    return f'{value:.6g}' if isinstance(value, float) else str(value)
