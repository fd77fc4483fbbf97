"""Results of the public face: cycles out of bags, linear systems, margins, identification, figures."""

import shutil
from types import SimpleNamespace

import control
import numpy as np
import pytest

import pkm_core as pkm
from pkm_core.control.margins import stability_margins, unit_circle
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.control.systems import open_loop, plant_system


@pytest.fixture(scope='module')
def machine():
    return pkm.load_machine('planar')


@pytest.fixture(scope='module')
def swept(machine):
    return pkm.identify(machine, 'd1', pkm.run_experiments(machine, 'd1', positions=1))


@pytest.fixture
def expected(machine):
    """Return the plant and the open loop of d3 as matrices of the core, by the function that makes them."""
    model, gains = load_model(machine)['d3'], load_control(machine)['d3']
    systems = plant_system(model, machine.sample_time), open_loop(gains, model, machine.sample_time)
    return dict(zip((pkm.axis_system, pkm.loop_system), systems, strict=True))


@pytest.mark.parametrize('form', ['ss', 'tf'])
@pytest.mark.parametrize('system_of', [pkm.axis_system, pkm.loop_system])
def test_system_answers_as_the_model_of_the_core(machine, expected, form, system_of):
    """Another order of summation costs some digits of a resonance, the polynomials of a transfer function more."""
    system = system_of(machine, 'd3', form=form)
    assert system.dt == machine.sample_time
    z = unit_circle([5.0, 50.0, 300.0], machine.sample_time)
    np.testing.assert_allclose(system(z), expected[system_of](z), rtol=1e-8 if form == 'ss' else 1e-6)


@pytest.mark.parametrize('system_of', [pkm.axis_system, pkm.loop_system])
def test_response_is_that_of_the_model_of_the_core(machine, expected, system_of):
    system = system_of(machine, 'd3', form='frd')
    z = np.exp(1j * system.omega * machine.sample_time)
    np.testing.assert_allclose(system.complex, expected[system_of](z), rtol=1e-12)


def test_closed_loop_of_python_control_is_stable(machine):
    assert (abs(control.feedback(pkm.loop_system(machine, 'd1')).poles()) < 1).all()


def test_margins_are_those_of_the_core(machine):
    gains, model = load_control(machine)['d1'], load_model(machine)['d1']
    found = pkm.margins(machine, 'd1')
    assert found.nominal == stability_margins(gains, model, machine.sample_time)
    assert found.worst.gain_margin < found.nominal.gain_margin
    assert pkm.margins(machine, 'd1', controller='computed_torque').nominal != found.nominal


def test_margins_take_another_model(machine):
    model = load_model(machine)['d1']
    stronger = model.model_copy(update={'gain': 10 * model.gain})
    assert repr(pkm.margins(machine, 'd1', model=stronger)).startswith('LoopMargins(d1: unstable, slowest pole')


@pytest.mark.parametrize('call', [pkm.axis_system, pkm.loop_system, pkm.margins, pkm.run_experiments])
def test_unknown_joint_is_refused(machine, call):
    with pytest.raises(pkm.PkmError, match=rf"^{call.__name__}: joint 'd9' given; known: \['d1', 'd3'\]"):
        call(machine, 'd9')


def test_unknown_form_is_refused(machine):
    with pytest.raises(pkm.PkmError, match=r"form 'zpk' given; known: 'ss', 'tf', 'frd'"):
        pkm.axis_system(machine, 'd1', form='zpk')


def test_gains_without_the_joint_are_refused(machine):
    with pytest.raises(pkm.PkmError, match=r"margins: controller \{\} given; expected a name or \{'d1': gains"):
        pkm.margins(machine, 'd1', controller={})


def test_bag_is_read_as_it_was_written(write_bag, make_cycle):
    recorded = make_cycle('planar')
    cycle = pkm.read_cycle(write_bag(recorded, 4, law='inverse', motion='short'))
    assert (cycle.number, cycle.motion, cycle.law, cycle.joints) == (4, 'short', 'inverse', recorded.machine.joints)
    np.testing.assert_allclose(cycle.error, recorded.error, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(cycle.columns()['d3 voltage [V]'], recorded.voltage[:, 1])
    assert set(cycle.metrics()) == {'d1', 'd3'}


def test_broken_off_cycle_has_no_metrics(start_recording, make_cycle):
    recording = start_recording(make_cycle('planar'))
    recording.ticks(30)
    cycle = pkm.read_cycle(recording.close())
    assert repr(cycle) == 'Cycle(1 of short, law fourier: 30 of 400 samples of 2 joints)'
    with pytest.raises(pkm.BagError, match='cycle 1: has 30 of 400 samples; metrics need all'):
        cycle.metrics()


def test_identification_finds_the_resonances(machine, swept):
    believed = load_model(machine)['d1']
    assert swept.gain == pytest.approx(believed.gain, rel=0.15)  # the simulated axis differs by some per cent
    assert swept.modes[0, 0] == pytest.approx(believed.modes[0].resonance, rel=0.05)
    assert swept.measured_response().dt == machine.sample_time
    assert swept.model.modes[0].resonance == swept.modes[0, 0]


def test_fitted_axis_answers_as_measured(machine, swept):
    measured = swept.measured_response()
    model = control.frequency_response(pkm.axis_system(machine, 'd1', model=swept.model), measured.omega)
    decibels = 20 * np.log10(abs(model.complex / measured.complex))
    assert np.abs(decibels).mean() < 0.5


def test_model_without_a_sweep_keeps_the_resonances(machine):
    fit = pkm.identify(machine, 'd1', pkm.run_experiments(machine, 'd1', kind='low_frequency'))
    assert fit.model.modes == load_model(machine)['d1'].modes
    assert fit.model.gain == fit.gain
    with pytest.raises(pkm.IdentificationError, match='d1: no measured response; expected a record with a sweep'):
        fit.measured_response()


def test_identify_refuses_what_is_no_record(machine):
    with pytest.raises(pkm.PkmError, match='identify: int among the records; expected bag folders or JointRecord'):
        pkm.identify(machine, 'd1', [3])


def test_bags_identify_an_axis(write_bag, machine):
    """Bits of a simulated cycle, through a bag."""
    result = pkm.simulate(machine, 'planar_80ms', law='inverse', cycles=2)
    bags = [write_bag(simulated(machine, result, number), number) for number in (1, 2)]
    fit = pkm.identify(machine, 'd1', bags)
    assert fit.gain == pytest.approx(load_model(machine)['d1'].gain, rel=0.15)


def simulated(machine, result, number):
    """Return a cycle of a `Simulation` as `write_bag` takes it."""
    motion, cycle = result.motion, result.cycle(number)
    return SimpleNamespace(
        machine=machine, poses=motion.poses, joints=motion.joints, error=cycle.error, voltage=cycle.voltage
    )


def test_every_result_plots_itself_with_labelled_axes(machine, swept, tmp_path):
    result = pkm.simulate(machine, cycles=2)
    results = [result.motion, result, result.cycle(1), pkm.margins(machine, 'd1'), swept]
    for number, each in enumerate(results):
        figure = each.plot()
        assert all(axes.get_ylabel() for axes in figure.axes)
        assert figure.axes[-1].get_xlabel()
        figure.savefig(tmp_path / f'{number}.png')
        assert (tmp_path / f'{number}.png').stat().st_size > 10_000


def test_configuration_folder_is_followed(tmp_path):
    folder = tmp_path / 'own'
    shutil.copytree(pkm.Configuration.of_environment().folder, folder)
    text = (folder / 'model' / 'planar.yaml').read_text()
    (folder / 'motions' / 'planar_80ms.yaml').rename(folder / 'motions' / 'planar_mine.yaml')
    (folder / 'model' / 'planar.yaml').write_text(text.replace('gain: ', 'gain: 1', 1))
    machine = pkm.load_machine('planar', configuration=folder)
    assert pkm.plan(machine, 'planar_mine').name == 'planar_mine'
    assert load_model(machine)['d1'].gain > 2 * load_model(pkm.load_machine('planar'))['d1'].gain
    with pytest.raises(pkm.ConfigError, match=r"configuration: '.*nowhere' given; expected a folder"):
        pkm.load_machine('planar', configuration=tmp_path / 'nowhere')


def test_move_time_replaces_that_of_the_motion(machine):
    slower = pkm.plan(machine, 'planar_80ms', move_time=0.1)
    assert slower.duration == pytest.approx(pkm.plan(machine, 'planar_80ms').duration + 2 * 0.02)
    with pytest.raises(pkm.TrajectoryError, match='planar_limits has limits, which give the duration'):
        pkm.plan(machine, 'planar_limits', move_time=0.1)
