"""`pkm parameters`: the page of all parameters, from what the nodes declare and the models of the files."""

from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from pkm_nodes.parts.loaded_config import CONFIG_HASH

HEAD = """# Parameters

Written by `pkm parameters --out docs/parameters.md`, from what the nodes declare and the models of the files; a test
compares them. All node parameters are read-only: set them with `-p name:=value` or a parameter file. In YAML a quantity
has its unit (`70 mm`); bounds are in the unit named. In keys, `{a, b}` stands for each of the names, `NAME` for one of
your own or of a joint, `[]` for every entry of a list.

"""
# of ROS, and one that a node sets itself
_NOT_SETTABLE = ('use_sim_time', 'start_type_description_service', 'qos_overrides.', CONFIG_HASH)


def parameters(
    out: Annotated[Path | None, typer.Option(help='Markdown file to write; without it the page is printed.')] = None,
):
    """
    List every parameter of the nodes and every key of the configuration files.

    Example: `pkm parameters --out docs/parameters.md`
    """
    page = parameter_page()
    if out:
        out.write_text(page, encoding='utf-8')
    else:
        typer.echo(page, nl=False)


def parameter_page():
    """Return the page; it starts every node for a moment, in a namespace where they meet no cell."""
    import rclpy
    from rclpy.parameter import Parameter

    from pkm_core.verbs.config_page import config_page, table
    from pkm_nodes.nodes.cell import NODES, CellNode
    from pkm_nodes.nodes.dashboard import DashboardNode

    rclpy.init(args=['--ros-args', '-r', '__ns:=/parameters', '-r', '/clock:=/parameters/clock'])
    sections = []
    with TemporaryDirectory() as folder, chdir(folder):  # the recorder makes its folder
        for name, node_type in {'cell': CellNode, **NODES, 'dashboard': DashboardNode}.items():
            node = node_type()
            rows = [
                (
                    f'`{parameter.name}`',
                    Parameter.Type(node.describe_parameter(parameter.name).type).name.lower(),
                    f'{parameter.value}' if parameter.value != '' else "''",
                    node.describe_parameter(parameter.name).description,
                )
                for parameter in node.get_parameters(node.list_parameters([], 0).names)
                if not parameter.name.startswith(_NOT_SETTABLE)
            ]
            sections.append(f'### {name}\n\n' + table(['parameter', 'type', 'default', ''], rows))
            for each in (node, *getattr(node, 'parts', ())):
                each.destroy_node()
    rclpy.shutdown()
    return HEAD + '## Nodes\n\n' + '\n'.join(sections) + '\n## Files\n\n' + config_page()
