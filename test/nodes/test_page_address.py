"""Address of the page: a URL that a browser opens, and hosts and ports that are refused in one line."""

import socket
from functools import partial

import pytest

from pkm_core.errors import PkmError
from pkm_nodes.nodes.dashboard import DashboardNode
from pkm_nodes.page.page import Page
from pkm_nodes.verbs.page import page_arguments


def free_port(host, family):
    with socket.create_server((host, 0), family=family) as server:
        return server.getsockname()[1]


@pytest.mark.parametrize(
    ('host', 'family', 'shown'), [('127.0.0.1', socket.AF_INET, '127.0.0.1'), ('::1', socket.AF_INET6, '[::1]')]
)
def test_address_is_a_url_with_brackets_for_ipv6(host, family, shown):
    try:
        port = free_port(host, family)
    except OSError:
        pytest.skip(f'this computer has no address {host}')
    page = Page(host, port)
    try:
        assert page.address == f'http://{shown}:{port}'
        socket.create_connection((host, port), timeout=10).close()
    finally:
        page.close()


@pytest.mark.parametrize('host', ['', '  ', 'no host', '192.0.2.1', '999.1.1.1', '::g', '\u00e9' * 80])
def test_host_that_is_no_address_of_this_computer_is_refused(host):
    with pytest.raises(PkmError, match=r'^page: [^\n]*(another with --host|or ::1)$'):
        Page(host, 8099)


def test_port_in_use_is_refused():
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(PkmError, match=f'cannot listen on 127.0.0.1 port {port}: Address already in use'):
            Page('127.0.0.1', port)


@pytest.mark.parametrize('host', ['127.0.0.1', '::1', '', "it's", 'yes', '1e3'])
def test_host_reaches_the_node_as_text(graph, host):
    node = graph.start(partial(DashboardNode, cli_args=page_arguments(8081, host)))
    assert (node.host, node.port) == (host, 8081)
