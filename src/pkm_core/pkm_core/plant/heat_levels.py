"""Section `heat` of an environment: thermal nodes of the machine, and what their temperature changes; see heat.py."""

from typing import Annotated

from pydantic import Field, model_validator

from pkm_core.config import Config, Number, quantity

_SHORTEST = 10.0  # [s] time constant of a node; chosen: temperatures are constant over a cycle

_Capacity = Annotated[quantity('J/K'), Field(gt=0.0, le=1e6)]
_Conductance = Annotated[quantity('W/K'), Field(ge=0.0, le=1e3)]
_Expansion = Annotated[quantity('1/K'), Field(ge=0.0, le=1e-4)]


class HeatNode(Config):
    """One body of uniform temperature."""

    capacity: _Capacity
    to_ambient: Annotated[_Conductance, Field(description='by air and by the base')]


class HeatLevels(Config):
    """Thermal nodes, their connections, and the coefficients of lengths and motors."""

    motors: Annotated[HeatNode, Field(description='each coil with its carriage')]
    links: Annotated[HeatNode, Field(description='each link on a carriage')]
    platform: Annotated[HeatNode, Field(description='upper links, platforms and end-effector together')]
    scales: Annotated[HeatNode, Field(description='each scale with its guide')]
    motor_to_link: _Conductance
    motor_to_scale: _Conductance
    link_to_platform: _Conductance
    friction_to_scale: Annotated[
        Number, Field(ge=0.0, le=1.0, description='share of the friction heat; the rest heats the carriage')
    ]
    copper: Annotated[quantity('1/K'), Field(ge=0.0, le=0.01, description='of the resistance of a coil')]
    magnets: Annotated[quantity('1/K'), Field(gt=-0.01, le=0.0, description='of the force constant')]
    links_expand: Annotated[_Expansion, Field(description='links and offsets')]
    scales_expand: _Expansion

    @model_validator(mode='after')
    def _agrees(self):
        ways = {
            'motors': ('motor_to_link', 'motor_to_scale'),
            'links': ('motor_to_link', 'link_to_platform'),
            'platform': ('link_to_platform',) * 4,
            'scales': ('motor_to_scale',),
        }
        for name, connections in ways.items():
            node, way = getattr(self, name), sum(getattr(self, connection) for connection in connections)
            if node.to_ambient + way == 0.0:
                raise ValueError(f'{name}.to_ambient: 0 W/K given, and no other connection; allowed above 0')
            constant = node.capacity / (node.to_ambient + way)
            if constant < _SHORTEST:
                raise ValueError(
                    f'{name}: time constant of {constant:g} s given (capacity over the conductances); '
                    f'allowed from {_SHORTEST:g} s'
                )
        if not any(getattr(self, name).to_ambient for name in ways):
            raise ValueError('to_ambient of all nodes: 0 W/K given; allowed above 0 for at least one')
        return self
