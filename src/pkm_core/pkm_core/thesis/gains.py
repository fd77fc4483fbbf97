"""
Tables 7.1 and 8.1 in the form of the thesis: gains per sample and per count, with the values of the thesis.

u = KP e + KI SUM e + KD (e - e_previous), e in encoder counts, u in codes of the converter, then a lag filter of DC
gain 10: 1 here is 5000 counts/mm * 10 V/32768 * 10 = 15.26 V/mm. A converter of 16 bits over the range of the drive is
an assumption (the resulting volts per millimetre agree within a third). Feedforward in the same form, from differences
of the reference.
"""

from pkm_core.control.axis import feedforward_gains

_CODES = 2**15  # of the converter from zero to its limit
_DC_GAIN = 10.0  # of the lag filter in the thesis

ROWS = (
    *('KP', 'KI', 'KD', 'Kv', 'Ka', 'Kj'),
    *('lag DC gain', 'lag F1 pole (Hz)', 'lag F2 zero (Hz)'),
    *('notch r (Hz)', 'notch b (Hz)', 'notch attenuation (dB)'),
    *('GM (dB)', 'PM (deg)', 'CLBW (Hz)', 'max abs(S) over CLBW'),
)
NUMBERS = {'planar': '7.1', 'four_dof': '8.1'}
_PRINTED = {  # None: not legible
    'planar': {
        'd1': (1.4429, 0.0038175, 12.424, 4.562, 22.232, None, 10, 331, 825, 371, 200, 10, 8.64, 48.4, 75.91, 0.81),
        'd3': (0.48379, 0.000222, 6.5531, 9.8422, 10, None, 10, 302, 891, 438, 300, 23, 7.54, 57.5, 41.85, 0.86),
    },
    'four_dof': {
        'd1': (0.7987, 0.003, 15.1038, 4.8751, 60.411, None, 10, 305, 533, 380, 400, 15, 8.01, 50, 69.6, 0.98),
        'd3': (0.7229, 0.001, 12.8725, 5.5518, 32.7569, None, 10, 316, 716, 446, 300, 25, 8.02, 50, 73.4, 0.85),
        'd5': (0.9122, 0.0005, 13.1532, 2.8185, 31.04, None, 10, 320, 690, 355, 400, 15, 8.69, 49.3, 59.3, 0.94),
        'd7': (0.8438, 0.01, 15.4657, 9.6264, 49.4113, None, 10, 305, 617, 370, 300, 30, 8.55, 60, 56.1, 0.7),
    },
}


def printed_column(machine_name, joint):
    """Return the values of the thesis in the order of ROWS; all None if it has no such table."""
    return _PRINTED.get(machine_name, {}).get(joint, (None,) * len(ROWS))


def table_markdown(machine_name, columns):
    """Return the table of the thesis for the machine together with our values; `columns` is {joint: own_column}."""
    number = NUMBERS.get(machine_name)
    title = f'Table {number}' if number else 'In the form of Table 7.1'
    lines = [f'{title}: gains per sample and per count; thesis and ours', '']
    header = ['parameter', *(f'{joint} {whose}' for joint in columns for whose in ('thesis', 'ours'))]
    lines += ['| ' + ' | '.join(header) + ' |', '|---' * len(header) + '|']
    for row, name in enumerate(ROWS):
        cells = [name]
        for joint, column in columns.items():
            theirs = printed_column(machine_name, joint)[row]
            cells += ['' if theirs is None else f'{theirs:g}', f'{column[row]:.4g}']
        lines.append('| ' + ' | '.join(cells) + ' |')
    lines += ['', 'Ours: CLBW is the frequency at which abs(S) reaches 1; max abs(S) is up to the target CLBW.']
    return '\n'.join(lines) + '\n'


def own_column(machine, gains, model, margins, band_sensitivity):
    """
    Return the values of one joint in the order of ROWS.

    CLBW is the frequency at which |S| reaches 1 (7.29); `band_sensitivity` is the largest |S| up to the target CLBW
    (up to the CLBW itself it is 1 by definition).
    """
    ts = machine.sample_time
    unit = machine.voltage_limit / _CODES / machine.encoder_resolution * _DC_GAIN / gains.lag.dc_gain  # V/m
    kv, ka, kj = feedforward_gains(gains, model, ts)
    return (
        *(gains.kp / unit, gains.ki * ts / unit, gains.kd / ts / unit),
        *(kv / ts / unit, ka / ts**2 / unit, kj / ts**3 / unit),
        *(_DC_GAIN, gains.lag.pole, gains.lag.zero),
        *(gains.notch.centre, gains.notch.width, gains.notch.attenuation),
        *(margins.gain_margin, margins.phase_margin, margins.bandwidth, band_sensitivity),
    )
