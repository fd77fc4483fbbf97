"""Draw of one built machine with the spreads of an environment: lengths, encoder offsets, payload, geometry."""

from pkm_core.machines.assembly import Assembly
from pkm_core.machines.built import drawn_length
from pkm_core.plant.geometry import RealAssembly, draw_geometry
from pkm_core.plant.noise import assembly_generator

_LINKS = {'four_dof': ('l2', 'l4', 'l6', 'l8', 'k10', 'k12'), 'planar': ('l2', 'l4'), 'xy_stage': ()}


def assemble(machine, truth, environment, seed):
    """Return the `Assembly` drawn with `seed` from the spreads of the environment."""
    draw = assembly_generator(seed)
    geometry = getattr(machine.config, 'geometry', None)
    encoder_offset = environment.encoder_offset * draw.standard_normal(len(machine.joints))
    payload = truth.payload.mass * (1.0 + environment.payload_spread * draw.standard_normal())
    lengths = {
        link: drawn_length(geometry, link) + environment.link_error * draw.standard_normal()
        for link in _LINKS[machine.config.mechanism]
    }
    built = (machine.config.mechanism, geometry, lengths, encoder_offset, payload)
    if environment.geometry is None:
        return Assembly(*built)
    return RealAssembly(*built, **draw_geometry(machine, truth, environment.geometry, draw))
